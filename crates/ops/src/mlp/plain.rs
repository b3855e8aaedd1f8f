//! The same network from plain tensor operations, on any backend.

use burn::tensor::{FloatDType, Tensor};

use super::{Activation, Dense, Precision, RadianceMlp};
use crate::dispatch::dispatch;
use crate::split::{fill_up, parts};

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
    let apply = |layer: &Dense, x: Tensor<2>, activation| dense(x, layer, activation, network.precision, parts);
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

/// The `activation` of a layer of `x`, `[M, N]`, M being a multiple of `parts`.
#[cfg_attr(not(feature = "cube"), allow(unused_variables, reason = "only GPUs take parts"))]
fn dense(x: Tensor<2>, layer: &Dense, activation: Activation, precision: Precision, parts: usize) -> Tensor<2> {
    let Dense { weight, bias } = layer.clone();
    dispatch! {
        &x.device();
        host => activation.apply(product(x, weight, precision) + bias.unsqueeze()),
        cube if x.dims()[0] > 0 && precision != Precision::F32 => crate::cube::dense(x, (weight, bias), activation, precision, parts),
        plain => activation.apply(product(x, weight, precision) + bias.unsqueeze()),
    }
}

fn product(x: Tensor<2>, weight: Tensor<2>, precision: Precision) -> Tensor<2> {
    match precision {
        Precision::F32 | Precision::Tf32 => x.matmul(weight),
        Precision::Bf16 => x.cast(FloatDType::BF16).matmul(weight.cast(FloatDType::BF16)).cast(FloatDType::F32),
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::{from_host, to_host};

    /// Values of x + b, and slopes that reach b.
    #[test]
    fn functions_of_a_sum_by_hand() {
        let device = Device::flex().autodiff();
        let (e, sigmoid) = (1f32.exp(), |x: f32| 1.0 / (1.0 + (-x).exp()));
        for (function, values, slope) in [
            (Activation::None, [-1.0, 2.0], 2.0),
            (Activation::Relu, [0.0, 2.0], 1.0),
            (Activation::ShiftedSoftplus, [(-2f32).exp().ln_1p(), e.ln_1p()], sigmoid(-2.0) + sigmoid(1.0)),
            (
                Activation::Sigmoid,
                [sigmoid(-1.0), sigmoid(2.0)],
                [-1.0, 2.0].map(|x| sigmoid(x) * sigmoid(-x)).iter().sum(),
            ),
        ] {
            let bias = Tensor::<1>::from_floats([1.0], &device).require_grad();
            let layer = Dense { weight: from_host(&[2.0], 1, &device), bias: bias.clone() };
            let out = dense(from_host(&[-1.0, 0.5], 1, &device), &layer, function, Precision::F32, 1);
            let slopes = to_host(bias.grad(&out.clone().sum().backward()).unwrap());
            for (found, want) in to_host(out).into_iter().zip(values).chain([(slopes[0], slope)]) {
                approx::assert_abs_diff_eq!(found, want, epsilon = 1e-6);
            }
        }
    }
}
