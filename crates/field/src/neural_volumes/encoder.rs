//! The encoder of Neural Volumes: from images of a frame to its latent code.

use burn::module::Module;
use burn::nn::Linear;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};
use infonerf_ops::bilinear::{Taps, bilinear};
use infonerf_ops::upload;
use infonerf_schedule::Fault;
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::code::Code;
use super::{COLOR, LEAKY_GAIN, LEAKY_SLOPE};
use crate::check::{check, check_range};
use crate::field::SourceView;
use crate::init::{self, glorot_linear};

/// Kernel of the convolutions, whose stride is 2 and whose padding is 1: each halves the resolution.
const KERNEL: usize = 4;
const MAX_CONVOLUTIONS: usize = 7;
/// Factors on the raw mean and on the raw ln σ.
const SCALES: (f32, f32) = (0.1, 0.01);

/// The encoder of [`NeuralVolumes`](crate::NeuralVolumes).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CodeEncoderConfig {
    /// Number of images, the first of the training views (released code: 3).
    pub images: usize,
    /// Rows and columns that images are resized to, multiples of 16 (released code: 512 and 384).
    pub size: [usize; 2],
    /// Channels of the first two convolutions, doubled after every two convolutions, up to four times as many (released
    /// code: 64). The dense layer behind them is eight times as wide.
    pub width: usize,
}

impl CodeEncoderConfig {
    pub(super) fn validate(&self) -> Result<(), Fault> {
        let &Self { images, size, width } = self;
        check_range("encoder.images", 1..=16, images)?;
        let good = |side: &usize| (16..=1024).contains(side) && side.is_multiple_of(16);
        check("encoder.size", "two multiples of 16 from 16 to 1024", format!("{size:?}"), size.iter().all(good))?;
        check_range("encoder.width", 1..=256, width)
    }

    /// Returns the channels of each convolution: w, w, 2w, 2w, then 4w, as long as rows and columns can be halved.
    fn channels(&self) -> Vec<usize> {
        let halvings = self.size.map(usize::trailing_zeros);
        let layers = MAX_CONVOLUTIONS.min(halvings[0].min(halvings[1]) as usize);
        (0..layers).map(|layer| self.width << (layer / 2).min(2)).collect()
    }

    fn features(&self) -> usize {
        let channels = self.channels();
        let cells: usize = self.size.iter().map(|side| side >> channels.len()).product();
        self.images * cells * channels.last().copied().unwrap_or(0)
    }

    fn hidden(&self) -> usize {
        8 * self.width
    }

    /// Returns the number of weights, without biases, for codes of `latent` elements.
    pub(super) fn parameters(&self, latent: usize) -> usize {
        let channels = self.channels();
        let inputs = std::iter::once(3).chain(channels.iter().copied());
        let tower: usize = inputs.zip(&channels).map(|(inputs, outputs)| KERNEL * KERNEL * inputs * outputs).sum();
        self.images * tower + self.hidden() * (self.features() + 2 * latent)
    }
}

/// A tower of convolutions for each image, then dense layers to mean and deviation of a code (Lombardi et al. 2019, Sec. 4.1).
#[derive(Module, Debug)]
pub(super) struct CodeEncoder {
    towers: Vec<Tower>,
    hidden: Linear,
    mean: Linear,
    log_deviation: Linear,
    #[module(skip)]
    size: [usize; 2],
}

/// Convolutions that halve the resolution. Each image has weights of its own.
#[derive(Module, Debug)]
struct Tower {
    layers: Vec<Conv2d>,
}

impl Tower {
    fn new(channels: &[usize], rng: &mut impl Rng, device: &Device) -> Self {
        let layer = |(inputs, &outputs): (usize, &usize)| {
            let fans = KERNEL * KERNEL * (inputs + outputs);
            let bound = LEAKY_GAIN * (6.0 / fans as f32).sqrt();
            init::convolution(rng, [inputs, outputs], [KERNEL, 2, 1], bound, device)
        };
        Self { layers: std::iter::once(3).chain(channels.iter().copied()).zip(channels).map(layer).collect() }
    }

    /// Maps an image `[1, 3, rows, columns]` to its features, `[1, F]`.
    fn features(&self, image: Tensor<4>) -> Tensor<2> {
        self.layers.iter().fold(image, |x, layer| leaky_relu(layer.forward(x), LEAKY_SLOPE)).flatten(1, 3)
    }
}

impl CodeEncoder {
    pub(super) fn new(config: &CodeEncoderConfig, latent: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let channels = config.channels();
        let (features, hidden) = (config.features(), config.hidden());
        Self {
            towers: (0..config.images).map(|_| Tower::new(&channels, rng, device)).collect(),
            hidden: glorot_linear(rng, features, hidden, LEAKY_GAIN, device),
            mean: glorot_linear(rng, hidden, latent, 1.0, device),
            log_deviation: glorot_linear(rng, hidden, latent, 1.0, device),
            size: config.size,
        }
    }

    /// Encodes the first `views`, of which there is at least one per tower.
    pub(super) fn code(&self, views: &[SourceView]) -> Code {
        let device = self.hidden.weight.val().device();
        let pairs = self.towers.iter().zip(views);
        let features = pairs.map(|(tower, view)| tower.features(image(view, self.size, &device))).collect();
        let hidden = leaky_relu(self.hidden.forward(Tensor::cat(features, 1)), LEAKY_SLOPE);
        Code {
            mean: self.mean.forward(hidden.clone()).squeeze_dim::<1>(0) * SCALES.0,
            log_deviation: self.log_deviation.forward(hidden).squeeze_dim::<1>(0) * SCALES.1,
        }
    }
}

/// Returns an image resized to `[1, 3, rows, columns]`, with corners aligned, and colours (255x − 100)/25.
fn image(view: &SourceView, [rows, columns]: [usize; 2], device: &Device) -> Tensor<4> {
    let (mean, deviation, white) = COLOR;
    let normalised: Vec<f32> = view.rgb.iter().flatten().map(|x| (white * x - mean) / deviation).collect();
    let pixels = upload(normalised, [view.rgb.len(), 3], device);
    let resized = bilinear(pixels, &Taps::resize(1, (view.height, view.width), (rows, columns)));
    resized.reshape([1, rows, columns, 3]).permute([0, 3, 1, 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the published size: seven convolutions to 4 × 3 cells of 256 channels, from each of three images.
    #[test]
    fn the_published_sizes() {
        let config = CodeEncoderConfig { images: 3, size: [512, 384], width: 64 };
        assert_eq!(config.validate(), Ok(()));
        assert_eq!(config.channels(), [64, 64, 128, 128, 256, 256, 256]);
        assert_eq!((config.features(), config.hidden()), (3 * 256 * 4 * 3, 512));
        let pairs = 3 * 64 + 64 * 64 + 64 * 128 + 128 * 128 + 128 * 256 + 2 * 256 * 256;
        assert_eq!(config.parameters(256), 3 * 16 * pairs + 512 * (9216 + 512));
    }
}
