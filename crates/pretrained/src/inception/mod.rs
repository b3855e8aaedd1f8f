//! Inception v3 (Szegedy et al. 2016) as pytorch-fid has it, whose features FID and KID compare.

mod resize;
mod units;

use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::Device;
use infonerf_metrics::protocol::InceptionInput;
use infonerf_metrics::{FeatureExtractor, Picture, Protocol};

use crate::TensorShape;
use crate::file::Named;
use crate::maps::{Convolution, Maps, Window, concatenate, max_pool, mean_pool, means};
use units::{Unit, units};

/// Side of the pictures that it looks at, in pixels.
const SIDE: usize = 299;
/// Pictures worked on at a time.
const BATCH: usize = 8;
/// ε of its batch normalisations.
const EPSILON: f32 = 1e-3;

const HALVING: Window = Window::square(3, 2, 0);
const AROUND: Window = Window::square(3, 1, 1);

/// How much of Inception there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InceptionConfig {
    /// By how much each number of channels is divided; 1 is the published network, of 2048 features.
    divisor: usize,
}

impl InceptionConfig {
    /// The published one.
    pub const FULL: Self = Self { divisor: 1 };
    /// One with a sixteenth of the channels, for tests.
    pub const NARROW: Self = Self { divisor: 16 };

    /// Names and shapes of its tensors, as pytorch-fid has them.
    pub fn tensors(self) -> Vec<TensorShape> {
        units(self.divisor).iter().flat_map(|unit| [unit.weight()].into_iter().chain(unit.normalisation())).collect()
    }
}

/// Inception up to its last mean over pixels. Three things differ from the usual network, as in the original TensorFlow
/// graph: 1008 classes (which are not looked at), mean pooling that leaves out padding, and max pooling in the last block.
/// Weights are fixed, and there is no gradient.
pub struct Inception {
    units: BTreeMap<String, Convolution>,
    device: Device,
}

impl Inception {
    /// Reads it from a weight file with pytorch-fid's names.
    ///
    /// # Errors
    /// One line that names the file, and the tensor which is missing or has another shape.
    pub fn read(path: &Path, config: InceptionConfig, device: &Device) -> Result<Self, String> {
        let device = device.clone().inner();
        let file = Named::open(path)?;
        let convolution = |unit: Unit| {
            let convolution = folded(&unit, &file, &device)?;
            Ok((unit.name, convolution))
        };
        let units = units(config.divisor).into_iter().map(convolution).collect::<Result<_, String>>()?;
        Ok(Self { units, device })
    }

    /// The features of each picture, resized as `input` says.
    pub fn features(&self, pictures: &[&Picture], input: InceptionInput) -> Vec<Vec<f32>> {
        let of_batch = |pictures: &[&Picture]| {
            let values = pictures.iter().flat_map(|picture| resize::resized(picture, SIDE, input)).collect();
            means(&self.last_maps(Maps::new(values, [pictures.len(), SIDE, SIDE, 3], &self.device)))
        };
        pictures.chunks(BATCH).flat_map(of_batch).collect()
    }

    fn last_maps(&self, x: Maps) -> Maps {
        let x = self.chain(&x, "", &["Conv2d_1a_3x3", "Conv2d_2a_3x3", "Conv2d_2b_3x3"]);
        let x = self.chain(&max_pool(&x, HALVING), "", &["Conv2d_3b_1x1", "Conv2d_4a_3x3"]);
        let x = max_pool(&x, HALVING);
        let x = ["Mixed_5b.", "Mixed_5c.", "Mixed_5d."].iter().fold(x, |x, block| self.block_a(&x, block));
        let x = self.block_b(&x, "Mixed_6a.");
        let blocks = ["Mixed_6b.", "Mixed_6c.", "Mixed_6d.", "Mixed_6e."];
        let x = blocks.iter().fold(x, |x, block| self.block_c(&x, block));
        let x = self.block_d(&x, "Mixed_7a.");
        let x = self.block_e(&x, "Mixed_7b.", mean_pool);
        self.block_e(&x, "Mixed_7c.", max_pool)
    }

    fn block_a(&self, x: &Maps, block: &str) -> Maps {
        concatenate([
            self.unit(x, block, "branch1x1"),
            self.chain(x, block, &["branch5x5_1", "branch5x5_2"]),
            self.chain(x, block, &["branch3x3dbl_1", "branch3x3dbl_2", "branch3x3dbl_3"]),
            self.unit(&mean_pool(x, AROUND), block, "branch_pool"),
        ])
    }

    fn block_b(&self, x: &Maps, block: &str) -> Maps {
        concatenate([
            self.unit(x, block, "branch3x3"),
            self.chain(x, block, &["branch3x3dbl_1", "branch3x3dbl_2", "branch3x3dbl_3"]),
            max_pool(x, HALVING),
        ])
    }

    fn block_c(&self, x: &Maps, block: &str) -> Maps {
        let long = ["branch7x7dbl_1", "branch7x7dbl_2", "branch7x7dbl_3", "branch7x7dbl_4", "branch7x7dbl_5"];
        concatenate([
            self.unit(x, block, "branch1x1"),
            self.chain(x, block, &["branch7x7_1", "branch7x7_2", "branch7x7_3"]),
            self.chain(x, block, &long),
            self.unit(&mean_pool(x, AROUND), block, "branch_pool"),
        ])
    }

    fn block_d(&self, x: &Maps, block: &str) -> Maps {
        concatenate([
            self.chain(x, block, &["branch3x3_1", "branch3x3_2"]),
            self.chain(x, block, &["branch7x7x3_1", "branch7x7x3_2", "branch7x7x3_3", "branch7x7x3_4"]),
            max_pool(x, HALVING),
        ])
    }

    fn block_e(&self, x: &Maps, block: &str, pool: fn(&Maps, Window) -> Maps) -> Maps {
        let (short, long) =
            (self.unit(x, block, "branch3x3_1"), self.chain(x, block, &["branch3x3dbl_1", "branch3x3dbl_2"]));
        concatenate([
            self.unit(x, block, "branch1x1"),
            self.unit(&short, block, "branch3x3_2a"),
            self.unit(&short, block, "branch3x3_2b"),
            self.unit(&long, block, "branch3x3dbl_3a"),
            self.unit(&long, block, "branch3x3dbl_3b"),
            self.unit(&pool(x, AROUND), block, "branch_pool"),
        ])
    }

    fn chain(&self, x: &Maps, block: &str, units: &[&str]) -> Maps {
        units.iter().fold(x.clone(), |x, unit| self.unit(&x, block, unit))
    }

    fn unit(&self, x: &Maps, block: &str, unit: &str) -> Maps {
        self.units[&format!("{block}{unit}")].forward(x)
    }
}

/// A convolution and the batch normalisation behind it: γ (W x − μ)/√(σ² + ε) + β = (s W) x + (β − s μ), s = γ/√(σ² + ε).
fn folded(unit: &Unit, file: &Named<'_>, device: &Device) -> Result<Convolution, String> {
    let mut weight = file.floats(&unit.weight())?;
    let [gamma, beta, mean, variance] = unit.normalisation().map(|tensor| file.floats(&tensor));
    let (gamma, mut bias, mean, variance) = (gamma?, beta?, mean?, variance?);
    let kernel = weight.len() / bias.len();
    for (channel, weights) in weight.chunks_exact_mut(kernel).enumerate() {
        let scale = gamma[channel] / (variance[channel] + EPSILON).sqrt();
        weights.iter_mut().for_each(|weight| *weight *= scale);
        bias[channel] -= scale * mean[channel];
    }
    Ok(Convolution::new(unit.window, unit.channels, (weight, bias), device))
}

impl FeatureExtractor for Inception {
    fn features(&self, pictures: &[&Picture], protocol: &Protocol) -> Result<Vec<Vec<f32>>, String> {
        Ok(self.features(pictures, protocol.inception_input))
    }
}
