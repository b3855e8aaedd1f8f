//! The same network from plain tensor operations, on any backend.

use burn::tensor::{FloatDType, Int, Tensor, TensorData, activation::relu};

use super::{ColorBranch, Dense, Precision, RadianceMlp};
use crate::frequency_encode;

/// [`radiance_mlp`](super::radiance_mlp) without any kernel.
pub fn plain(encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    let apply = |layer: &Dense, x: Tensor<2>| apply(layer, x, network.precision);
    let mut h = encoded.clone();
    for (index, layer) in network.trunk.iter().enumerate() {
        if index > 0 && index == network.skip {
            h = Tensor::cat(vec![encoded.clone(), h], 1);
        }
        h = relu(apply(layer, h));
    }
    let sigma = apply(&network.sigma, h.clone());
    match &network.color {
        Some(branch) => Tensor::cat(vec![sigma, color(branch, h, apply)], 1),
        None => sigma,
    }
}

fn apply(layer: &Dense, x: Tensor<2>, precision: Precision) -> Tensor<2> {
    let weight = layer.weight.clone();
    let product = match precision {
        Precision::F32 => x.matmul(weight),
        Precision::Bf16 => x.cast(FloatDType::BF16).matmul(weight.cast(FloatDType::BF16)).cast(FloatDType::F32),
    };
    product + layer.bias.clone().unsqueeze()
}

fn color(branch: &ColorBranch, trunk: Tensor<2>, apply: impl Fn(&Dense, Tensor<2>) -> Tensor<2>) -> Tensor<2> {
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
