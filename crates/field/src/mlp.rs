//! The layers that NeRF and mip-NeRF share (Mildenhall et al. 2020, Fig. 7).

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Int, Tensor, TensorData, activation::relu};
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use rand::Rng;

use crate::{Points, init::Init};

/// Sizes of [`Mlp`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct MlpSize {
    /// Width of the encoded position.
    pub(crate) inputs: usize,
    /// Hidden layers of the trunk.
    pub(crate) layers: usize,
    /// Width of the trunk; the view branch has half of it.
    pub(crate) width: usize,
    /// The trunk layer that sees the encoded position again.
    pub(crate) skip: usize,
    /// Octaves of the direction's encoding.
    pub(crate) direction_octaves: usize,
}

/// Encoded position → trunk of ReLU layers with one skip → density; trunk features and encoded direction → colour.
#[derive(Module, Debug)]
pub(crate) struct Mlp {
    trunk: Vec<Linear>,
    sigma: Linear,
    feature: Linear,
    view: Linear,
    rgb: Linear,
    #[module(skip)]
    skip: usize,
    #[module(skip)]
    direction_octaves: usize,
}

impl Mlp {
    pub(crate) fn new(size: MlpSize, init: Init, rng: &mut impl Rng, device: &Device) -> Self {
        let MlpSize { inputs, layers, width, skip, direction_octaves } = size;
        let trunk = (0..layers)
            .map(|layer| {
                let fan_in = match layer {
                    0 => inputs,
                    layer if layer == skip => width + inputs,
                    _ => width,
                };
                init.linear(rng, fan_in, width, device)
            })
            .collect();
        Self {
            trunk,
            sigma: init.linear(rng, width, 1, device),
            feature: init.linear(rng, width, width, device),
            view: init.linear(rng, width + encoded_width(3, direction_octaves), width / 2, device),
            rgb: init.linear(rng, width / 2, 3, device),
            skip,
            direction_octaves,
        }
    }

    /// From encoded positions `[M, inputs]` to density `[M]` and, if `color`, colour `[M, 3]`, both before activation.
    pub(crate) fn forward(
        &self,
        encoded: Tensor<2>,
        points: Points<'_>,
        color: bool,
    ) -> (Tensor<1>, Option<Tensor<2>>) {
        let mut h = encoded.clone();
        for (layer, linear) in self.trunk.iter().enumerate() {
            if layer > 0 && layer == self.skip {
                h = Tensor::cat(vec![encoded.clone(), h], 1);
            }
            h = relu(linear.forward(h));
        }
        let sigma = self.sigma.forward(h.clone()).squeeze_dim(1);
        (sigma, color.then(|| self.color(h, points)))
    }

    fn color(&self, trunk: Tensor<2>, points: Points<'_>) -> Tensor<2> {
        let feature = self.feature.forward(trunk);
        let direction = self.encode_directions(points);
        let h = relu(self.view.forward(Tensor::cat(vec![feature, direction], 1)));
        self.rgb.forward(h)
    }

    /// One encoded row a ray, repeated for each of its samples.
    fn encode_directions(&self, points: Points<'_>) -> Tensor<2> {
        let device = self.device();
        let rays = frequency_encode(points.directions, 3, self.direction_octaves, &[], &device);
        let owners = points.segments.owners();
        let samples = owners.len();
        rays.select(0, Tensor::<1, Int>::from_data(TensorData::new(owners, [samples]), &device))
    }

    pub(crate) fn device(&self) -> Device {
        self.sigma.weight.val().device()
    }
}
