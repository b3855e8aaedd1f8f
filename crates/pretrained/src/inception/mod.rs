//! Inception v3 (Szegedy et al. 2016) as in pytorch-fid, whose features FID and KID compare.

mod network;

use std::collections::HashMap;
use std::path::Path;

use burn::tensor::{Device, Tensor};
use infonerf_metrics::Picture;
use infonerf_ops::to_host;

use crate::file::{TensorShape, WeightFile};
use crate::layers::{Convolution, maps_of_pixels, max_pool, mean_pool};
use network::{InceptionLayer, UnitShape, inception, units};

const SIDE: usize = 299;
/// ε of the batch normalisations.
const EPSILON: f32 = 1e-3;

/// Width of Inception.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InceptionConfig {
    /// Divisor of each number of channels.
    divisor: usize,
}

impl InceptionConfig {
    /// The published network, of 2048 features.
    pub const FULL: Self = Self { divisor: 1 };
    /// A network with a sixteenth of the channels, for tests.
    pub const NARROW: Self = Self { divisor: 16 };

    /// Returns names and shapes of the network's tensors, as in pytorch-fid.
    pub fn tensors(self) -> Vec<TensorShape> {
        let layers = inception(self.divisor);
        units(&layers).into_iter().flat_map(|unit| [unit.weight()].into_iter().chain(unit.normalisation())).collect()
    }
}

/// Inception up to its last mean over pixels.
///
/// Three things differ from the usual network, as in the original TensorFlow graph: 1008 classes (which are not computed),
/// mean pooling that leaves out padding, and max pooling in the last block. Weights are fixed, and there is no gradient.
pub struct Inception {
    layers: Vec<InceptionLayer>,
    /// Convolutions by the name of their unit.
    convolutions: HashMap<String, Convolution>,
    device: Device,
}

impl Inception {
    /// Reads the network from a weight file with pytorch-fid's names.
    ///
    /// # Errors
    /// One line that names the file, and the tensor which is missing or has another shape.
    pub fn read(path: &Path, config: InceptionConfig, device: &Device) -> Result<Self, String> {
        let device = device.clone().inner();
        let file = WeightFile::read(path)?;
        let layers = inception(config.divisor);
        let convolution = |unit: &UnitShape| {
            let values = file.folded(&unit.weight(), &unit.normalisation(), EPSILON)?;
            Ok((unit.name.clone(), Convolution::new(unit.window, unit.channels, values, &device)))
        };
        let convolutions = units(&layers).into_iter().map(convolution).collect::<Result<_, String>>()?;
        Ok(Self { layers, convolutions, device })
    }

    /// Computes the features of each picture, all pictures in one pass.
    pub fn features(&self, pictures: &[&Picture]) -> Vec<Vec<f32>> {
        let values = pictures.iter().flat_map(|picture| resized(picture)).collect();
        let maps = self.forward(&self.layers, maps_of_pixels(values, [pictures.len(), SIDE, SIDE], &self.device));
        let means = maps.flatten::<3>(2, 3).mean_dim(2);
        let features = means.dims()[1];
        to_host(means).chunks_exact(features).map(<[f32]>::to_vec).collect()
    }

    fn forward(&self, layers: &[InceptionLayer], x: Tensor<4>) -> Tensor<4> {
        layers.iter().fold(x, |x, layer| match layer {
            InceptionLayer::Unit(unit) => self.convolutions[&unit.name].forward(x),
            InceptionLayer::MaxPool(window) => max_pool(x, *window),
            InceptionLayer::MeanPool(window) => mean_pool(x, *window),
            InceptionLayer::Branches(branches) => {
                Tensor::cat(branches.iter().map(|branch| self.forward(branch, x.clone())).collect(), 1)
            }
        })
    }
}

/// Resizes a picture to the network's input, row-major with channels innermost: bilinear without a low-pass filter, as PyTorch's
/// `interpolate(mode="bilinear", align_corners=False)`, and then 2x − 1.
fn resized(picture: &Picture) -> Vec<f32> {
    let ([width, height], pixels) = (picture.size(), picture.pixels());
    let place = |at: usize, from: usize| {
        let at = ((at as f64 + 0.5) * (from as f64 / SIDE as f64) - 0.5).clamp(0.0, (from - 1) as f64);
        let before = at as usize;
        (before, (before + 1).min(from - 1), (at - before as f64) as f32)
    };
    let [columns, rows] = [width, height].map(|from| (0..SIDE).map(|at| place(at, from)).collect::<Vec<_>>());
    let mix = |a: f32, b: f32, share: f32| (1.0 - share) * a + share * b;
    let mut values = Vec::with_capacity(3 * SIDE * SIDE);
    for &(upper, lower, down) in &rows {
        for &(left, right, across) in &columns {
            let row = |y: usize, channel: usize| {
                mix(pixels[y * width + left][channel], pixels[y * width + right][channel], across)
            };
            values.extend([0, 1, 2].map(|channel| 2.0 * mix(row(upper, channel), row(lower, channel), down) - 1.0));
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_width_has_the_published_number_of_parameters() {
        let layers = inception(1);
        let units = units(&layers);
        assert_eq!(units.len(), 94);
        let weights: usize = units.iter().map(|unit| unit.weight().1.iter().product::<usize>()).sum();
        let normalisation: usize = units.iter().map(|unit| 2 * unit.channels[1]).sum();
        // torchvision's Inception v3 has 23,834,568 without its auxiliary head; 2,049,000 of them classify 1000 classes.
        assert_eq!(weights + normalisation, 23_834_568 - 2_049_000);
    }
}
