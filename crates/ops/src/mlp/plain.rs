//! The same network from plain tensor operations, on any backend.

use burn::tensor::{FloatDType, Tensor};

use super::{Activation, Dense, Precision, RadianceMlp};
use crate::split::{fill_up, parts, product};

/// [`radiance_mlp`](super::radiance_mlp) without any kernel of the host.
pub fn plain(encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    match layers(encoded, network, [Activation::None; 2]) {
        (sigma, Some(color)) => Tensor::cat(vec![sigma, color], 1),
        (sigma, None) => sigma,
    }
}

/// Density `[M, 1]` and colour `[M, 3]`, after `activations` of each.
pub(super) fn layers(
    encoded: Tensor<2>,
    network: &RadianceMlp,
    activations: [Activation; 2],
) -> (Tensor<2>, Option<Tensor<2>>) {
    let samples = encoded.dims()[0];
    let parts = parts(samples, &encoded.device());
    let encoded = fill_up(encoded, parts);
    let apply = |layer: &Dense, x: Tensor<2>, activation: Activation| {
        let weight = layer.weight.clone();
        let product = match network.precision {
            Precision::F32 => product(x, weight, parts),
            Precision::Bf16 => {
                product(x.cast(FloatDType::BF16), weight.cast(FloatDType::BF16), parts).cast(FloatDType::F32)
            }
        };
        activation.of_biased(product, layer.bias.clone())
    };
    let mut h = encoded.clone();
    for (index, layer) in network.trunk.iter().enumerate() {
        if index > 0 && index == network.skip {
            h = Tensor::cat(vec![encoded.clone(), h], 1);
        }
        h = apply(layer, h, Activation::Relu);
    }
    let filled = |rows: Tensor<2>| if rows.dims()[0] == samples { rows } else { rows.narrow(0, 0, samples) };
    let sigma = filled(apply(&network.sigma, h.clone(), activations[0]));
    let color = network.color.as_ref().map(|branch| {
        // One encoded row per ray, repeated for each of its samples.
        let direction = fill_up(branch.segments.spread(branch.encoded_directions()), parts);
        let feature = apply(&branch.feature, h, Activation::None);
        let h = apply(&branch.view, Tensor::cat(vec![feature, direction], 1), Activation::Relu);
        filled(apply(&branch.rgb, h, activations[1]))
    });
    (sigma, color)
}
