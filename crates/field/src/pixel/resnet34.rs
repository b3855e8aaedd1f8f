//! Weights of torchvision's `resnet34` for the encoder.

use infonerf_schedule::Fault;
use std::path::Path;

use burn::nn::conv::Conv2d;
use infonerf_pretrained::WeightFile;

use super::encoder::{ImageEncoder, ResidualBlock};
use crate::init::parameter;

const EPSILON: f32 = 1e-5;

/// Replaces all weights of `encoder` by those of the safetensors file at `path`, under torchvision's names.
///
/// # Errors
/// If the file cannot be read, or a tensor is missing or has another shape.
pub(super) fn load(encoder: ImageEncoder, path: &Path) -> Result<ImageEncoder, Fault> {
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
    let statistics = ["weight", "bias", "running_mean", "running_var"];
    let statistics = statistics.map(|part| (format!("{normalisation}.{part}"), vec![shape[0]]));
    let (weight, bias) = file.folded(&(format!("{convolution}.weight"), shape.to_vec()), &statistics, EPSILON)?;
    let device = layer.weight.val().device();
    layer.weight = parameter(weight, shape, &device);
    layer.bias = Some(parameter(bias, [shape[0]], &device));
    Ok(())
}
