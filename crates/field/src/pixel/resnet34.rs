//! Weights of torchvision's `resnet34` for the encoder.

use std::path::Path;

use burn::module::Param;
use burn::nn::conv::Conv2d;
use burn::tensor::TensorData;
use safetensors::{Dtype, SafeTensors};

use super::encoder::{Block, Encoder};
use crate::ConfigError;

/// torchvision's `BatchNorm2d.eps`.
const EPSILON: f32 = 1e-5;

/// Replaces all weights of `encoder` by those of the safetensors file at `path`, under torchvision's names.
///
/// # Errors
/// If the file cannot be read, or a tensor is missing or has another shape.
pub(super) fn load(mut encoder: Encoder, path: &Path) -> Result<Encoder, ConfigError> {
    let fault = |cause: String| ConfigError {
        field: "encoder.weights",
        expected: "a safetensors file of torchvision's resnet34 (scripts/resnet34.py writes one)",
        found: format!("{}: {cause}", path.display()),
    };
    let bytes = std::fs::read(path).map_err(|error| fault(error.to_string()))?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(|error| fault(format!("no safetensors file: {error:?}")))?;
    let file = File { tensors };
    file.fill(&mut encoder.stem, "conv1", "bn1").map_err(fault)?;
    for (stage, blocks) in encoder.stages.iter_mut().enumerate() {
        for (index, block) in blocks.iter_mut().enumerate() {
            file.fill_block(block, &format!("layer{}.{index}", stage + 1)).map_err(fault)?;
        }
    }
    Ok(encoder)
}

struct File<'a> {
    tensors: SafeTensors<'a>,
}

impl File<'_> {
    fn fill_block(&self, block: &mut Block, name: &str) -> Result<(), String> {
        self.fill(&mut block.first, &format!("{name}.conv1"), &format!("{name}.bn1"))?;
        self.fill(&mut block.second, &format!("{name}.conv2"), &format!("{name}.bn2"))?;
        match &mut block.shortcut {
            Some(shortcut) => {
                self.fill(shortcut, &format!("{name}.downsample.0"), &format!("{name}.downsample.1"))
            }
            None => Ok(()),
        }
    }

    /// A convolution and the batch normalisation behind it: γ (W x − μ)/√(σ² + ε) + β = (s W) x + (β − s μ), s = γ/√(σ² + ε).
    fn fill(&self, layer: &mut Conv2d, convolution: &str, normalisation: &str) -> Result<(), String> {
        let shape = layer.weight.dims();
        let mut weight = self.floats(&format!("{convolution}.weight"), &shape)?;
        let statistic = |name: &str| self.floats(&format!("{normalisation}.{name}"), &shape[..1]);
        let (gamma, mut bias) = (statistic("weight")?, statistic("bias")?);
        let (mean, variance) = (statistic("running_mean")?, statistic("running_var")?);
        let kernel = weight.len() / shape[0];
        for (channel, weights) in weight.chunks_exact_mut(kernel).enumerate() {
            let scale = gamma[channel] / (variance[channel] + EPSILON).sqrt();
            weights.iter_mut().for_each(|w| *w *= scale);
            bias[channel] -= scale * mean[channel];
        }
        let device = layer.weight.val().device();
        layer.weight = Param::from_data(TensorData::new(weight, shape), &device);
        layer.bias = Some(Param::from_data(TensorData::new(bias, [shape[0]]), &device));
        Ok(())
    }

    fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
        let tensor = self.tensors.tensor(name).map_err(|_| format!("no tensor `{name}`"))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            return Err(format!("`{name}` is {:?} {:?}, not F32 {shape:?}", tensor.dtype(), tensor.shape()));
        }
        Ok(tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }
}
