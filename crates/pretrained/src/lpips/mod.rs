//! LPIPS 0.1 (Zhang, Isola, Efros, Shechtman, Wang 2018), a learned perceptual distance between two images.

mod config;

pub use config::LpipsConfig;

use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};
use infonerf_metrics::Picture;
use infonerf_metrics::protocol::LpipsInput;
use infonerf_ops::{has_host_kernels, to_host};

use crate::file::{TensorShape, WeightFile};
use crate::layers::{Convolution, maps_of_pixels, max_pool};
use config::{ConvolutionShape, LpipsLayer};

/// Mean and standard deviation of each channel, for images in [−1, 1].
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Constant added to the length of a feature vector, which may be 0.
const EPSILON: f32 = 1e-10;

/// Learned perceptual distance
///
/// `d(x, y) = Σ_l mean_hw Σ_c w_lc (x̂_lhwc − ŷ_lhwc)²`
///
/// with the features of layer l of a backbone, scaled to unit length at each pixel, `x̂ = x / (‖x‖ + 1e-10)`, and a learned
/// weight `w` per channel. Weights are fixed, and there is no gradient.
pub struct Lpips {
    config: LpipsConfig,
    /// Convolutions, and the weights `w`, `[1, channels, 1, 1]`, of those after which images are compared.
    convolutions: Vec<(Convolution, Option<Tensor<4>>)>,
    device: Device,
}

impl Lpips {
    /// Reads the backbone (torchvision's `features`) and the heads (of the `lpips` package) from a weight file each.
    ///
    /// # Errors
    /// One line that names the file, and the tensor which is missing or has another shape.
    pub fn read(backbone: &Path, heads: &Path, config: LpipsConfig, device: &Device) -> Result<Self, String> {
        let device = device.clone().inner();
        let backbone = WeightFile::read(backbone)?;
        let heads = WeightFile::read(heads)?;
        let head = |(name, shape): TensorShape| {
            let weights = heads.floats(&name, &shape)?;
            let shape = [1, weights.len(), 1, 1];
            Ok::<_, String>(Tensor::from_data(TensorData::new(weights, shape), &device))
        };
        let convolution = |shape: &ConvolutionShape| {
            let [weight, bias] = shape.tensors().map(|(name, shape)| backbone.floats(&name, &shape));
            let head = shape.head_tensor().map(head).transpose();
            let convolution = Convolution::new(shape.window, shape.channels, (weight?, bias?), &device);
            Ok((convolution, head?))
        };
        let convolutions = config.convolutions().map(convolution).collect::<Result<_, String>>()?;
        Ok(Self { config, convolutions, device })
    }

    /// Computes the distance of a pair; VGG-16 takes about 3 KiB of memory per pixel.
    ///
    /// # Errors
    /// One line if the images differ in size, or are too small for the backbone.
    pub fn distance(&self, render: &Picture, truth: &Picture, input: LpipsInput) -> Result<f64, String> {
        let [width, height] = truth.size();
        if render.size() != truth.size() {
            let (render, truth) = (render.size(), truth.size());
            return Err(format!("images of {render:?} and {truth:?} pixels cannot be compared"));
        }
        if !self.config.fits([height, width]) {
            return Err(format!("{width}×{height} pixels are too few for its convolutions"));
        }
        let features = |picture: &Picture| self.features(picture, input);
        // Some of Burn's operations on the host use one thread.
        let (x, y) = match has_host_kernels(&self.device) {
            true => rayon::join(|| features(render), || features(truth)),
            false => (features(render), features(truth)),
        };
        let weights = self.convolutions.iter().filter_map(|(_, weights)| weights.as_ref());
        Ok(x.into_iter().zip(y).zip(weights).map(|((x, y), weights)| difference(x, y, weights)).sum())
    }

    /// Computes the features of each layer that is compared, scaled to unit length at each pixel.
    fn features(&self, picture: &Picture, input: LpipsInput) -> Vec<Tensor<4>> {
        let mut maps = self.input(picture, input);
        let (mut features, mut convolutions) = (Vec::new(), self.convolutions.iter());
        for layer in &self.config.layers {
            if let LpipsLayer::Pool(window) = layer {
                maps = max_pool(maps, *window);
                continue;
            }
            let (convolution, weights) = convolutions.next().expect("each shape was read");
            maps = convolution.forward(maps);
            if weights.is_some() {
                features.push(unit_length(maps.clone()));
            }
        }
        features
    }

    /// Uploads an image, with each channel shifted and scaled to what the backbone was trained on.
    fn input(&self, picture: &Picture, input: LpipsInput) -> Tensor<4> {
        let value = |value: f32, channel: usize| {
            let value = if input == LpipsInput::Signed { 2.0 * value - 1.0 } else { value };
            (value - SHIFT[channel]) / SCALE[channel]
        };
        let pixels = picture.pixels().iter();
        let values = pixels.flat_map(|pixel| [0, 1, 2].map(|channel| value(pixel[channel], channel))).collect();
        let [width, height] = picture.size();
        maps_of_pixels(values, [1, height, width], &self.device)
    }
}

/// Returns `x / (‖x‖ + 1e-10)` at each pixel.
fn unit_length(maps: Tensor<4>) -> Tensor<4> {
    maps.clone() / (maps.square().sum_dim(1).sqrt() + EPSILON)
}

/// Returns `mean_hw Σ_c w_c (x̂_hwc − ŷ_hwc)²` for the features x̂ and ŷ of two images.
fn difference(x: Tensor<4>, y: Tensor<4>, weights: &Tensor<4>) -> f64 {
    f64::from(to_host(((x - y).square() * weights.clone()).sum_dim(1).mean())[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_has_the_closed_form() {
        // 1×2 pixels with 2 channels: (3, 4) against (1, 0), and 0 against (0, 2).
        let device = Device::flex();
        let maps = [[[[3.0, 0.0]], [[4.0, 0.0]]], [[[1.0, 0.0]], [[0.0, 2.0]]]];
        let [x, y] = maps.map(|maps| unit_length(Tensor::from_floats([maps], &device)));
        let found = difference(x, y, &Tensor::from_floats([[[[0.5]], [[2.0]]]], &device));
        let expected = (0.5 * 0.16 + 2.0 * 0.64 + 2.0) / 2.0;
        approx::assert_relative_eq!(found, expected, max_relative = 1e-6);
    }
}
