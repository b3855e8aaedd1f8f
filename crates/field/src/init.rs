//! Weights drawn on the host, so that a seed gives the same network on every backend and thread.

use burn::module::Param;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, TensorData};
use rand::Rng;

/// Numbers uniform in [−bound, bound].
pub(crate) fn uniform(rng: &mut impl Rng, count: usize, bound: f32) -> Vec<f32> {
    (0..count).map(|_| rng.random_range(-1.0f32..=1.0) * bound).collect()
}

/// A dense layer with PyTorch's default initialisation: weights and biases uniform in ±1/√fan_in.
pub(crate) fn linear(rng: &mut impl Rng, fan_in: usize, fan_out: usize, device: &Device) -> Linear {
    let bound = (1.0 / fan_in as f32).sqrt();
    let mut layer = LinearConfig::new(fan_in, fan_out).init(device);
    let weight = uniform(rng, fan_in * fan_out, bound);
    let bias = uniform(rng, fan_out, bound);
    layer.weight = Param::from_data(TensorData::new(weight, [fan_in, fan_out]), device);
    layer.bias = Some(Param::from_data(TensorData::new(bias, [fan_out]), device));
    layer
}
