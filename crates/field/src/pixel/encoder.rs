//! The image encoder of PixelNeRF: the first stages of a ResNet (He et al. 2016), read at every resolution.

use std::path::Path;

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::ops::MaxPoolOptions;
use burn::tensor::{Device, Tensor, activation::relu, module::max_pool2d};
use infonerf_ops::bilinear::{Taps, bilinear};
use infonerf_ops::upload;
use infonerf_pretrained::WeightFile;
use infonerf_schedule::Fault;
use rand::Rng;

use super::EncoderConfig;
use crate::field::SourceView;
use crate::init::{self, parameter};

/// Factor by which the stem makes images smaller.
pub(super) const STEM_STRIDE: usize = 2;

/// ε of torchvision's batch normalisation.
const EPSILON: f32 = 1e-5;

/// Stem and stages of residual blocks: `width` channels in the stem and the first stage, twice as many in each further one.
///
/// Batch normalisation is in inference form, an affine map per channel, and folded into the convolution before it: the few
/// images of a scene are too small a batch for statistics.
#[derive(Module, Debug)]
pub(super) struct ImageEncoder {
    stem: Conv2d,
    stages: Vec<Vec<ResidualBlock>>,
}

/// relu(s(x) + conv₂(relu(conv₁(x)))), s the identity or a 1 × 1 convolution.
#[derive(Module, Debug)]
struct ResidualBlock {
    first: Conv2d,
    second: Conv2d,
    shortcut: Option<Conv2d>,
}

impl ResidualBlock {
    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let h = self.second.forward(relu(self.first.forward(x.clone())));
        relu(h + self.shortcut.as_ref().map_or_else(|| x.clone(), |shortcut| shortcut.forward(x.clone())))
    }
}

/// Builds a convolution that pads by half its kernel; weights uniform in ±gain·√(6/fan_in) (He et al. 2015), biases 0.
fn convolution(
    rng: &mut impl Rng,
    channels: [usize; 2],
    [kernel, stride]: [usize; 2],
    gain: f32,
    device: &Device,
) -> Conv2d {
    let fan_in = channels[0] * kernel * kernel;
    init::convolution(rng, channels, [kernel, stride, kernel / 2], gain * (6.0 / fan_in as f32).sqrt(), device)
}

impl ImageEncoder {
    pub(super) fn new(config: &EncoderConfig, rng: &mut impl Rng, device: &Device) -> Self {
        let stem = convolution(rng, [3, config.width], [7, STEM_STRIDE], 1.0, device);
        let blocks = |(stage, &count): (usize, &usize)| {
            let outputs = config.width << stage;
            let block = |index: usize| {
                let (inputs, stride) = if index == 0 && stage > 0 { (outputs / 2, 2) } else { (outputs, 1) };
                ResidualBlock {
                    first: convolution(rng, [inputs, outputs], [3, stride], 1.0, device),
                    // Initially 0, so that a block starts as its shortcut, and depth does not add up (Goyal et al. 2017).
                    second: convolution(rng, [outputs, outputs], [3, 1], 0.0, device),
                    shortcut: (stride > 1).then(|| convolution(rng, [inputs, outputs], [1, stride], 1.0, device)),
                }
            };
            (0..count).map(block).collect()
        };
        Self { stem, stages: config.blocks.iter().enumerate().map(blocks).collect() }
    }

    pub(super) fn channels(&self) -> usize {
        // Each stage has as many channels as the stem and all stages before it together.
        self.stem.weight.dims()[0] << self.stages.len()
    }

    pub(super) fn map_size(view: &SourceView) -> (usize, usize) {
        (view.height.div_ceil(STEM_STRIDE), view.width.div_ceil(STEM_STRIDE))
    }

    /// Computes the features of every texel: stem and stages, each resized to the stem's resolution, side by side; `[V·h·w, C]`.
    pub(super) fn features(&self, views: &[SourceView], device: &Device) -> Tensor<2> {
        let to = Self::map_size(&views[0]);
        let mut x = relu(self.stem.forward(images(views, device)));
        let mut levels = vec![rows(x.clone())];
        // As in torchvision's ResNet: 3 × 3, stride 2, padding 1.
        x = max_pool2d(x, MaxPoolOptions::new([3, 3]).with_stride([2, 2]).with_padding([1, 1]));
        for stage in &self.stages {
            x = stage.iter().fold(x, |x, block| block.forward(x));
            let [maps, _, height, width] = x.dims();
            levels.push(bilinear(rows(x.clone()), &Taps::resize(maps, (height, width), to)));
        }
        Tensor::cat(levels, 1)
    }
}

/// Permutes `[V, C, h, w]` to one row per texel, `[V·h·w, C]`.
fn rows(maps: Tensor<4>) -> Tensor<2> {
    let [views, channels, height, width] = maps.dims();
    maps.permute([0, 2, 3, 1]).reshape([views * height * width, channels])
}

/// Returns colours as the network takes them, [−1, 1], `[V, 3, H, W]`.
fn images(views: &[SourceView], device: &Device) -> Tensor<4> {
    let (height, width) = (views[0].height, views[0].width);
    let planes = views.iter().flat_map(|view| (0..3).flat_map(|c| view.rgb.iter().map(move |rgb| 2.0 * rgb[c] - 1.0)));
    upload(planes.collect::<Vec<f32>>(), [views.len(), 3, height, width], device)
}

/// Replaces all weights of `encoder` by those of the file at `path`, safetensors or PyTorch's, under torchvision's names.
pub(super) fn load_resnet34(encoder: ImageEncoder, path: &Path) -> Result<ImageEncoder, Fault> {
    let expected = "a file of the tensors of torchvision's resnet34 (scripts/resnet34.py writes one)";
    let filled = WeightFile::read(path).and_then(|file| filled(encoder, &file));
    filled.map_err(|cause| Fault::new("field.encoder.weights", expected, cause))
}

fn filled(mut encoder: ImageEncoder, file: &WeightFile) -> Result<ImageEncoder, String> {
    fill(&mut encoder.stem, file, "conv1", "bn1")?;
    for (stage, blocks) in encoder.stages.iter_mut().enumerate() {
        for (index, block) in blocks.iter_mut().enumerate() {
            let name = format!("layer{}.{index}", stage + 1);
            let ResidualBlock { first, second, shortcut } = block;
            fill(first, file, &format!("{name}.conv1"), &format!("{name}.bn1"))?;
            fill(second, file, &format!("{name}.conv2"), &format!("{name}.bn2"))?;
            if let Some(shortcut) = shortcut {
                fill(shortcut, file, &format!("{name}.downsample.0"), &format!("{name}.downsample.1"))?;
            }
        }
    }
    Ok(encoder)
}

/// Fills a convolution with its weights and, folded into them, those of the batch normalisation behind it.
fn fill(layer: &mut Conv2d, file: &WeightFile, convolution: &str, normalisation: &str) -> Result<(), String> {
    let shape = layer.weight.dims();
    let statistics = infonerf_pretrained::normalisation(normalisation, shape[0]);
    let (weight, bias) = file.folded(&(format!("{convolution}.weight"), shape.to_vec()), &statistics, EPSILON)?;
    let device = layer.weight.val().device();
    layer.weight = parameter(weight, shape, &device);
    layer.bias = Some(parameter(bias, [shape[0]], &device));
    Ok(())
}
