//! Initial weights, drawn on the host so that a seed gives the same network on every backend.

use burn::module::Param;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Linear, PaddingConfig2d};
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;
use rand_distr::StandardNormal;

/// Uploads the initial values of a parameter, row-major.
pub(crate) fn parameter<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    Param::from_data(TensorData::new(values, shape), device)
}

/// Draws values uniform in [−bound, bound].
pub(crate) fn uniform(rng: &mut impl Rng, count: usize, bound: f32) -> Vec<f32> {
    (0..count).map(|_| rng.random_range(-1.0f32..=1.0) * bound).collect()
}

pub(crate) fn normal(rng: &mut impl Rng, count: usize) -> Vec<f32> {
    (0..count).map(|_| rng.sample(StandardNormal)).collect()
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Init {
    /// PyTorch's default: weights and biases uniform in ±1/√fan_in.
    FanIn,
    /// Weights uniform in ±√(6/(fan_in + fan_out)), biases 0 (Glorot & Bengio 2010), as in the released mip-NeRF.
    Glorot,
}

impl Init {
    pub(crate) fn linear(self, rng: &mut impl Rng, fan_in: usize, fan_out: usize, device: &Device) -> Linear {
        let [bound, bias_bound] = match self {
            Self::FanIn => [(1.0 / fan_in as f32).sqrt(); 2],
            Self::Glorot => [(6.0 / (fan_in + fan_out) as f32).sqrt(), 0.0],
        };
        let weight = uniform(rng, fan_in * fan_out, bound);
        dense(weight, uniform(rng, fan_out, bias_bound), device)
    }
}

/// Builds the dense layer of `weight`, `[fan_in, fan_out]` row-major, and `bias`.
fn dense(weight: Vec<f32>, bias: Vec<f32>, device: &Device) -> Linear {
    let (fan_in, fan_out) = (weight.len() / bias.len(), bias.len());
    let weight = parameter(weight, [fan_in, fan_out], device);
    Linear { weight, bias: Some(parameter(bias, [fan_out], device)) }
}

/// Builds a dense layer (Glorot & Bengio 2010): weights uniform in ±gain·√(6/(fan_in + fan_out)), biases 0.
pub(crate) fn glorot_linear(rng: &mut impl Rng, fan_in: usize, fan_out: usize, gain: f32, device: &Device) -> Linear {
    let weight = uniform(rng, fan_in * fan_out, gain * (6.0 / (fan_in + fan_out) as f32).sqrt());
    dense(weight, vec![0.0; fan_out], device)
}

/// Builds a dense layer for ReLU networks (He et al. 2015): weights uniform in ±gain·√(6/fan_in), biases 0.
pub(crate) fn he_linear(rng: &mut impl Rng, fan_in: usize, fan_out: usize, gain: f32, device: &Device) -> Linear {
    dense(uniform(rng, fan_in * fan_out, gain * (6.0 / fan_in as f32).sqrt()), vec![0.0; fan_out], device)
}

/// Builds a square convolution: weights uniform in ±`bound`, biases 0.
pub(crate) fn convolution(
    rng: &mut impl Rng,
    [inputs, outputs]: [usize; 2],
    [kernel, stride, padding]: [usize; 3],
    bound: f32,
    device: &Device,
) -> Conv2d {
    let mut layer = Conv2dConfig::new([inputs, outputs], [kernel; 2])
        .with_stride([stride; 2])
        .with_padding(PaddingConfig2d::Explicit(padding, padding, padding, padding))
        .init(device);
    let weight = uniform(rng, inputs * outputs * kernel * kernel, bound);
    layer.weight = parameter(weight, [outputs, inputs, kernel, kernel], device);
    layer.bias = Some(parameter(vec![0.0; outputs], [outputs], device));
    layer
}
