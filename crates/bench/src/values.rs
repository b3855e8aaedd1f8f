//! Values on the host and on a device, and layers of networks.

use burn::tensor::{Device, Gradients, Tensor, TensorData};
use fastrand::Rng;
use infonerf_ops::mlp::Dense;
use infonerf_ops::to_host;

pub(crate) fn uniform(rng: &mut Rng, count: usize, low: f32, high: f32) -> Vec<f32> {
    (0..count).map(|_| low + (high - low) * rng.f32()).collect()
}

pub(crate) fn leaf(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), &device.clone().autodiff()).require_grad()
}

/// Returns the gradient with respect to a leaf; empty if it has none.
pub(crate) fn gradient_of<const D: usize>(leaf: &Tensor<D>, gradients: &Gradients) -> Vec<f32> {
    leaf.grad(gradients).map(to_host).unwrap_or_default()
}

/// Joins density and colour to rows, `[M, 4]`, or `[M, 1]` without colour.
pub(crate) fn joined((density, color): (Tensor<1>, Option<Tensor<2>>)) -> Tensor<2> {
    Tensor::cat(std::iter::once(density.unsqueeze_dim(1)).chain(color).collect(), 1)
}

pub(crate) fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}

/// Number of outputs of a layer, and its matrix and bias one after the other.
pub(crate) type LayerValues = (usize, Vec<f32>);

/// Draws a layer whose outputs are about as large as its inputs.
pub(crate) fn layer(rng: &mut Rng, inputs: usize, outputs: usize) -> LayerValues {
    let bound = (6.0 / inputs as f32).sqrt();
    (outputs, uniform(rng, (inputs + 1) * outputs, -bound, bound))
}

/// Draws `layers` layers of `width`, of which those of index 0 and `skip` read an encoded position of width `encoded`.
pub(crate) fn trunk(rng: &mut Rng, [encoded, width]: [usize; 2], layers: usize, skip: usize) -> Vec<LayerValues> {
    let inputs = |index| match index {
        0 => encoded,
        _ if index == skip => encoded + width,
        _ => width,
    };
    (0..layers).map(|index| layer(rng, inputs(index), width)).collect()
}

/// Makes a leaf of each layer's values, and the layers of these leaves.
pub(crate) fn leaves(layers: &[LayerValues], device: &Device) -> (Vec<Tensor<1>>, Vec<Dense>) {
    let leaves: Vec<_> = layers.iter().map(|(_, values)| leaf(values, device)).collect();
    let dense = |(leaf, (outputs, _)): (&Tensor<1>, &LayerValues)| {
        let weights = leaf.dims()[0] - outputs;
        let weight = leaf.clone().narrow(0, 0, weights).reshape([-1, *outputs as i32]);
        Dense { weight, bias: leaf.clone().narrow(0, weights, *outputs) }
    };
    let dense = leaves.iter().zip(layers).map(dense).collect();
    (leaves, dense)
}
