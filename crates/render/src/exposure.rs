use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::{to_host, upload};

use crate::image::RenderedImage;
use crate::output::{Passes, RenderOutput};

/// Gain and bias per training view and channel, for images of one scene that differ in exposure and white balance.
///
/// A training view shows `gain · C + bias + (1 − A) · background` with colour C and opacity A of a ray, as in the released code
/// of Neural Volumes (Lombardi et al. 2019), whose colours range to 255 and whose biases thus learn 255 times more slowly. Gains
/// start at 1, biases at 0. Pictures apply neither: they have the mean exposure of the training views ([`Self::centred`]).
#[derive(Module, Debug)]
pub struct Exposure {
    /// `[V, 3]`.
    gain: Param<Tensor<2>>,
    /// `[V, 3]`, colours in [0, 1].
    bias: Param<Tensor<2>>,
}

impl Exposure {
    /// Makes gains of 1 and biases of 0 for each of `views` training views.
    pub fn new(views: usize, device: &Device) -> Self {
        let parameter = |value: f32| Param::from_data(TensorData::new(vec![value; 3 * views], [views, 3]), device);
        Self { gain: parameter(1.0), bias: parameter(0.0) }
    }

    /// Shifts gains to a mean of 1 and biases to a mean of 0 over the views, for each channel: otherwise both would drift.
    #[must_use]
    pub fn centred(self) -> Self {
        let with_mean = |values: Param<Tensor<2>>, mean: f32| {
            values.map(|values| (values.clone() - values.mean_dim(0) + mean).detach().require_grad())
        };
        Self { gain: with_mean(self.gain, 1.0), bias: with_mean(self.bias, 0.0) }
    }

    /// Returns the colours, `[R, 3]`, that training views show of rays with colour `color` on `background`, `[R, 3]`,
    /// and opacity `acc`, `[R]`. `views` holds the training view of each ray.
    ///
    /// # Panics
    /// If `views` and rays differ in number.
    pub fn apply(&self, color: Tensor<2>, acc: Tensor<1>, background: [f32; 3], views: &[usize]) -> Tensor<2> {
        let device = color.device();
        let views = upload(views.iter().map(|&view| view as i32).collect(), [color.dims()[0]], &device);
        let [gain, bias] = [&self.gain, &self.bias].map(|values| values.val().select(0, views.clone()));
        let background = upload(background.to_vec(), [1, 3], &device);
        let behind = (acc.neg() + 1.0).unsqueeze_dim::<2>(1) * background;
        (color - behind.clone()) * gain + bias + behind
    }

    /// Returns `picture`, on `background`, as training view `view` shows it.
    pub(crate) fn expose(&self, picture: RenderedImage, background: [f32; 3], view: usize) -> RenderedImage {
        let (rays, device) = (picture.rgb.len(), self.gain.device());
        let color = upload(picture.rgb.as_flattened().to_vec(), [rays, 3], &device);
        let acc = upload(picture.acc.clone(), [rays], &device);
        let exposed = to_host(self.apply(color, acc, background, &vec![view; rays]));
        RenderedImage { rgb: exposed.as_chunks().0.to_vec(), ..picture }
    }
}

impl Passes {
    /// Returns both passes with the exposure of each ray's training view.
    pub fn exposed(self, exposure: &Exposure, views: &[usize]) -> Self {
        let exposed = |pass: RenderOutput| {
            let color = pass.color.map(|color| exposure.apply(color, pass.acc.clone(), pass.background, views));
            RenderOutput { color, ..pass }
        };
        Self { coarse: self.coarse.map(exposed), fine: exposed(self.fine) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picture_takes_the_exposure_of_its_view() {
        let device = Device::flex().autodiff();
        let parameter = |values: [f32; 6]| Param::from_data(TensorData::new(values.to_vec(), [2, 3]), &device);
        let (gain, bias) = (parameter([1.0, 1.0, 1.0, 2.0, 1.0, 0.5]), parameter([0.0, 0.0, 0.0, 0.0, 0.25, 0.0]));
        // The second pixel shows half of the background.
        let (rgb, acc) = (vec![[0.25; 3], [0.625; 3]], vec![1.0, 0.5]);
        let picture = RenderedImage { rgb, acc, ..RenderedImage::default() };
        let shown = |exposure: &Exposure| exposure.expose(picture.clone(), [1.0, 0.5, 0.0], 1).rgb;
        let exposure = Exposure { gain, bias };
        assert_eq!(shown(&exposure), [[0.5, 0.5, 0.125], [0.75, 0.875, 0.3125]]);
        assert_eq!(shown(&exposure.centred()), [[0.375, 0.375, 0.1875], [0.6875, 0.75, 0.46875]]);
    }
}
