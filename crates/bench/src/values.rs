//! Values on the host and on a device.

use burn::tensor::{Device, Gradients, Tensor, TensorData};
use fastrand::Rng;
use infonerf_ops::to_host;

/// Draws `count` values in [`low`, `high`).
pub(crate) fn uniform(rng: &mut Rng, count: usize, low: f32, high: f32) -> Vec<f32> {
    (0..count).map(|_| low + (high - low) * rng.f32()).collect()
}

/// Makes a leaf tensor that requires a gradient.
pub(crate) fn leaf(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), &device.clone().autodiff()).require_grad()
}

/// Returns the gradient with respect to a leaf; empty if it has none.
pub(crate) fn gradient_of<const D: usize>(leaf: &Tensor<D>, gradients: &Gradients) -> Vec<f32> {
    leaf.grad(gradients).map(to_host).unwrap_or_default()
}

/// Converts values to `f64` for the oracle.
pub(crate) fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}
