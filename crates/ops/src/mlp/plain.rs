//! Dense layers from Burn's matrix products, on any backend.

use burn::tensor::{FloatDType, Tensor};

use super::{Activation, Dense, Precision, RadianceMlp};
use crate::dispatch::dispatch;

/// Computes [`radiance_mlp`](super::radiance_mlp) without a kernel of the host.
pub fn plain(
    encoded: Tensor<2>,
    network: &RadianceMlp,
    [sigma, rgb]: [Activation; 2],
) -> (Tensor<1>, Option<Tensor<2>>) {
    let apply = |layer: &Dense, x: Tensor<2>, activation| dense(x, layer, activation, network.precision);
    let mut h = encoded.clone();
    for (index, layer) in network.trunk.iter().enumerate() {
        if index > 0 && index == network.skip {
            h = Tensor::cat(vec![encoded.clone(), h], 1);
        }
        h = apply(layer, h, Activation::Relu);
    }
    let sigma = apply(&network.sigma, h.clone(), sigma);
    let color = network.color.as_ref().map(|branch| {
        // One encoded row per ray, repeated for each of its samples.
        let direction = branch.segments.spread(branch.encoded_directions());
        let feature = apply(&branch.feature, h, Activation::None);
        let h = apply(&branch.view, Tensor::cat(vec![feature, direction], 1), Activation::Relu);
        apply(&branch.rgb, h, rgb)
    });
    (sigma.squeeze_dim(1), color)
}

/// Evaluates `activation(x W + b)` of a layer, `[M, inputs]` → `[M, outputs]`; differentiable in all three.
pub(crate) fn dense(x: Tensor<2>, layer: &Dense, activation: Activation, precision: Precision) -> Tensor<2> {
    dispatch! {
        &x.device();
        cube if x.dims()[0] > 0 => {
            let kernel = super::gpu::GpuDense { activation, precision };
            let [x, weight] = [x, layer.weight.clone()].map(Tensor::into_dispatch);
            crate::cube::apply(kernel, [x, weight, layer.bias.clone().into_dispatch()])
        },
        plain => {
            let bf16 = |factor: Tensor<2>| factor.cast(FloatDType::BF16);
            let product = match precision {
                Precision::F32 => x.matmul(layer.weight.clone()),
                Precision::Bf16 => bf16(x).matmul(bf16(layer.weight.clone())).cast(FloatDType::F32),
            };
            activation.apply(product + layer.bias.clone().unsqueeze())
        },
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::traffic::{to_host, upload_rows};

    /// Compares values of f(2x + b), and the gradient with respect to b.
    #[test]
    fn activations_and_their_gradients_by_hand() {
        let device = Device::flex().autodiff();
        let (e, sigmoid) = (1f32.exp(), |x: f32| 1.0 / (1.0 + (-x).exp()));
        for (function, values, gradient) in [
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
            let layer = Dense { weight: upload_rows(&[2.0], 1, &device), bias: bias.clone() };
            let out = dense(upload_rows(&[-1.0, 0.5], 1, &device), &layer, function, Precision::F32);
            let gradients = to_host(bias.grad(&out.clone().sum().backward()).unwrap());
            for (found, want) in to_host(out).into_iter().zip(values).chain([(gradients[0], gradient)]) {
                approx::assert_abs_diff_eq!(found, want, epsilon = 1e-6);
            }
        }
    }
}
