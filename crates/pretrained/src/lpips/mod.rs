//! LPIPS 0.1 (Zhang, Isola, Efros, Shechtman, Wang 2018), a learned perceptual distance between two images.

mod config;

pub use config::LpipsConfig;

use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};
use infonerf_metrics::Picture;
use infonerf_metrics::protocol::LpipsInput;
use infonerf_ops::{has_host_kernels, to_host};
use rayon::prelude::*;

use crate::file::{TensorShape, WeightFile};
use crate::layers::{Convolution, Window, maps_of_pixels, max_pool};
use config::LpipsLayer;

/// Mean and standard deviation of each channel, for images in [−1, 1].
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Min number of rows of a band: the maps of 64 channels of a band, unlike those of an image, fit into a processor's cache.
const BAND: usize = 64;
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
    layers: Vec<Layer>,
    device: Device,
}

#[allow(clippy::large_enum_variant, reason = "a network has a few layers")]
enum Layer {
    /// Convolution, and the weights `w`, `[1, channels, 1, 1]`, if images are compared after it.
    Convolution(Convolution, Option<Tensor<4>>),
    Pool(Window),
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
        let layer = |layer: &LpipsLayer| {
            let shape = match layer {
                LpipsLayer::Convolution(shape) => shape,
                LpipsLayer::Pool(window) => return Ok(Layer::Pool(*window)),
            };
            let [weight, bias] = shape.tensors().map(|(name, shape)| backbone.floats(&name, &shape));
            let head = shape.head_tensor().map(head).transpose();
            let convolution = Convolution::new(shape.window, shape.channels, (weight?, bias?), &device);
            Ok(Layer::Convolution(convolution, head?))
        };
        let layers = config.layers.iter().map(layer).collect::<Result<_, String>>()?;
        Ok(Self { config, layers, device })
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
        let inputs = [render, truth].map(|picture| self.input(picture, input));
        let (first, others) = self.layers.split_at(self.config.in_bands);
        let bands = if has_host_kernels(&self.device) && !first.is_empty() { (height / BAND).max(1) } else { 1 };
        let (distance, [x, y]) = first_block(&inputs, first, bands);
        // Some of Burn's operations on the host use one thread.
        let (x, y) = match has_host_kernels(&self.device) {
            true => rayon::join(|| features(x, others), || features(y, others)),
            false => (features(x, others), features(y, others)),
        };
        Ok(distance + differences(x.0, y.0, others))
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

/// Computes the distance after the first `layers` of two images, and the maps after them, in `bands` of rows side by side. A band
/// overlaps its neighbours by the rows that reach into it.
fn first_block(images: &[Tensor<4>; 2], layers: &[Layer], bands: usize) -> (f64, [Tensor<4>; 2]) {
    let (mut overlap, mut stride) = (0, 1);
    for layer in layers {
        match layer {
            Layer::Convolution(convolution, _) => overlap += convolution.window.padding[0],
            Layer::Pool(window) => stride *= window.stride,
        }
    }
    let height = images[0].dims()[2];
    let band = |index: usize| {
        let (start, end) = (index * BAND, if index + 1 == bands { height } else { (index + 1) * BAND });
        let (top, bottom) = (start.saturating_sub(overlap), height.min(end + overlap));
        let of_image = |image: &Tensor<4>| {
            let (features, maps) = features(image.clone().narrow(2, top, bottom - top), layers);
            let inner = |maps: Tensor<4>| maps.narrow(2, start - top, end - start);
            let maps = maps.narrow(2, (start - top) / stride, (end - start) / stride);
            (features.into_iter().map(inner).collect(), maps)
        };
        let [(x, x_maps), (y, y_maps)] = images.each_ref().map(of_image);
        (differences(x, y, layers) * (end - start) as f64 / height as f64, x_maps, y_maps)
    };
    let found: Vec<_> = (0..bands).into_par_iter().map(band).collect();
    let distance = found.iter().map(|(distance, ..)| distance).sum();
    let (x, y) = found.into_iter().map(|(_, x, y)| (x, y)).unzip();
    (distance, [Tensor::cat(x, 2), Tensor::cat(y, 2)])
}

/// Computes the features after each layer with a comparison, scaled to unit length at each pixel, and the maps after all.
fn features(mut maps: Tensor<4>, layers: &[Layer]) -> (Vec<Tensor<4>>, Tensor<4>) {
    let mut features = Vec::new();
    for layer in layers {
        match layer {
            Layer::Pool(window) => maps = max_pool(maps, *window),
            Layer::Convolution(convolution, weights) => {
                maps = convolution.forward(maps);
                features.extend(weights.is_some().then(|| unit_length(maps.clone())));
            }
        }
    }
    (features, maps)
}

fn unit_length(maps: Tensor<4>) -> Tensor<4> {
    maps.clone() / (maps.square().sum_dim(1).sqrt() + EPSILON)
}

/// Returns the sum of [`difference`] over the `layers` after which images are compared.
fn differences(x: Vec<Tensor<4>>, y: Vec<Tensor<4>>, layers: &[Layer]) -> f64 {
    let weights = layers.iter().filter_map(|layer| match layer {
        Layer::Convolution(_, weights) => weights.as_ref(),
        Layer::Pool(_) => None,
    });
    x.into_iter().zip(y).zip(weights).map(|((x, y), weights)| difference(x, y, weights)).sum()
}

/// Returns `mean_hw Σ_c w_c (x̂_hwc − ŷ_hwc)²` for the features x̂ and ŷ of two images.
fn difference(x: Tensor<4>, y: Tensor<4>, weights: &Tensor<4>) -> f64 {
    f64::from(to_host(((x - y).square() * weights.clone()).sum_dim(1).mean())[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks that bands give what whole images give, also where the last band has an odd number of rows.
    #[test]
    fn bands_make_no_difference() {
        let device = Device::flex();
        let random = |count: usize, seed: f32| (0..count).map(|i| (seed * i as f32).sin()).collect::<Vec<f32>>();
        let convolution = |inputs: usize, seed| {
            let weights = (random(9 * 4 * inputs, seed), random(4, seed));
            Convolution::new(Window::square(3, 1, 1), [inputs, 4], weights, &device)
        };
        let head = Tensor::from_data(TensorData::new(vec![0.5, 1.0, 2.0, 0.1], [1, 4, 1, 1]), &device);
        let layers = [
            Layer::Convolution(convolution(3, 1.7), None),
            Layer::Convolution(convolution(4, 2.3), Some(head)),
            Layer::Pool(Window::square(2, 2, 0)),
        ];
        let images = [3.1, 4.7].map(|seed| {
            let data = TensorData::new(random(3 * 205 * 9, seed), [1, 3, 205, 9]);
            Tensor::from_data(data, &device)
        });
        let [(whole, maps), (in_bands, band_maps)] = [1, 3].map(|bands| first_block(&images, &layers, bands));
        approx::assert_relative_eq!(whole, in_bands, max_relative = 1e-6);
        assert!(whole > 0.1 && maps[0].dims() == [1, 4, 102, 4], "{whole} {:?}", maps[0].dims());
        for (a, b) in maps.into_iter().zip(band_maps) {
            assert!(to_host((a - b).abs().max())[0] < 1e-5);
        }
    }

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
