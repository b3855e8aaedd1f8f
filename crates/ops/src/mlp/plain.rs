//! The same network from plain tensor operations, on any backend.

use burn::tensor::{FloatDType, Tensor, activation::relu};

use super::{ColorBranch, Dense, Precision, RadianceMlp};
use crate::split::{fill_up, parts, product};

/// [`radiance_mlp`](super::radiance_mlp) without any kernel.
pub fn plain(encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    let samples = encoded.dims()[0];
    let parts = parts(samples, &encoded.device());
    let encoded = fill_up(encoded, parts);
    let apply = |layer: &Dense, x: Tensor<2>| apply(layer, x, network.precision, parts);
    let mut h = encoded.clone();
    for (index, layer) in network.trunk.iter().enumerate() {
        if index > 0 && index == network.skip {
            h = Tensor::cat(vec![encoded.clone(), h], 1);
        }
        h = relu(apply(layer, h));
    }
    let sigma = apply(&network.sigma, h.clone());
    let out = match &network.color {
        Some(branch) => Tensor::cat(vec![sigma, color(branch, h, parts, apply)], 1),
        None => sigma,
    };
    out.narrow(0, 0, samples)
}

fn apply(layer: &Dense, x: Tensor<2>, precision: Precision, parts: usize) -> Tensor<2> {
    let weight = layer.weight.clone();
    let product = match precision {
        Precision::F32 => product(x, weight, parts),
        Precision::Bf16 => {
            product(x.cast(FloatDType::BF16), weight.cast(FloatDType::BF16), parts).cast(FloatDType::F32)
        }
    };
    product + layer.bias.clone().unsqueeze()
}

fn color(
    branch: &ColorBranch,
    trunk: Tensor<2>,
    parts: usize,
    apply: impl Fn(&Dense, Tensor<2>) -> Tensor<2>,
) -> Tensor<2> {
    // One encoded row per ray, repeated for each of its samples.
    let direction = branch.encoded_directions().select(0, branch.segments.owners(&trunk.device()));
    let direction = fill_up(direction, parts);
    let feature = apply(&branch.feature, trunk);
    let h = relu(apply(&branch.view, Tensor::cat(vec![feature, direction], 1)));
    apply(&branch.rgb, h)
}
