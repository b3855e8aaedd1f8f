//! The same network from plain tensor operations, on any backend.

use burn::tensor::{Int, Tensor, TensorData, activation::relu};

use super::{ColorBranch, Dense, RadianceMlp};
use crate::frequency_encode;

/// [`radiance_mlp`](super::radiance_mlp) without any kernel.
pub fn plain(encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    let mut h = encoded.clone();
    for (index, layer) in network.trunk.iter().enumerate() {
        if index > 0 && index == network.skip {
            h = Tensor::cat(vec![encoded.clone(), h], 1);
        }
        h = relu(apply(layer, h));
    }
    let sigma = apply(&network.sigma, h.clone());
    match &network.color {
        Some(branch) => Tensor::cat(vec![sigma, color(branch, h)], 1),
        None => sigma,
    }
}

fn apply(layer: &Dense, x: Tensor<2>) -> Tensor<2> {
    x.matmul(layer.weight.clone()) + layer.bias.clone().unsqueeze()
}

fn color(branch: &ColorBranch, trunk: Tensor<2>) -> Tensor<2> {
    // One encoded row a ray, repeated for each of its samples.
    let device = trunk.device();
    let rays = frequency_encode(&branch.directions, 3, branch.frequencies, &[], &device);
    let owners = branch.segments.owners();
    let samples = owners.len();
    let direction = rays.select(0, Tensor::<1, Int>::from_data(TensorData::new(owners, [samples]), &device));
    let feature = apply(&branch.feature, trunk);
    let h = relu(apply(&branch.view, Tensor::cat(vec![feature, direction], 1)));
    apply(&branch.rgb, h)
}
