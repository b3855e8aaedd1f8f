//! The network that NeRF and mip-NeRF share (Mildenhall et al. 2020, Fig. 7), as one operation.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;
mod network;
mod plain;
#[cfg(feature = "cube")]
mod product;
#[cfg(any(feature = "cube", test))]
mod tall;

pub use network::{Activation, ColorBranch, Dense, Precision, RadianceMlp};
pub(crate) use plain::dense;
pub use plain::plain;

use burn::tensor::Tensor;

use crate::dispatch::dispatch;

/// Evaluates the network at encoded positions, `[M, E]`: density, `[M]`, and red, green and blue, `[M, 3]`, if `network` has
/// colour, each after its activation. Differentiable in every weight and bias, and in `encoded`.
///
/// With h₀ = x, hₗ = relu(Wₗ hₗ₋₁ + bₗ), where layer `skip` reads (x, hₗ₋₁): density is W_σ h_L + b_σ, and colour is W_c v + b_c of
/// v = relu(W_v (W_f h_L + b_f, γ(d)) + b_v) with the encoded view direction γ(d) (Mildenhall et al. 2020, Fig. 7).
///
/// # Panics
/// If the layers do not fit on top of each other, or the device lacks the precision.
pub fn radiance_mlp(
    encoded: Tensor<2>,
    network: &RadianceMlp,
    activations: [Activation; 2],
) -> (Tensor<1>, Option<Tensor<2>>) {
    dispatch! {
        &encoded.device();
        host => {
            let size = encoded.dims();
            let (density, color) = split_density_and_color(match network.precision {
                Precision::F32 => on_host(host::MlpKernel::new(size, network), encoded, network),
                Precision::Bf16 => on_host(crate::bf16::RoundedMlpKernel::new(size, network), encoded, network),
            });
            (activations[0].apply(density), color.map(|color| activations[1].apply(color)))
        },
        plain => plain(encoded, network, activations),
    }
}

/// Applies a kernel of x, weights and biases of each layer, and the encoded direction of each ray if the network has colour.
#[cfg(feature = "flex")]
fn on_host(kernel: impl crate::host::Kernel, encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    let shape = [encoded.dims()[0], if network.color.is_some() { 4 } else { 1 }];
    let parameters =
        network.layers().flat_map(|layer| [layer.weight.clone().into_dispatch(), layer.bias.clone().into_dispatch()]);
    let directions = network.color.as_ref().map(|branch| branch.encoded_directions().into_dispatch());
    crate::host::apply(kernel, shape, std::iter::once(encoded.into_dispatch()).chain(parameters).chain(directions))
}

/// Splits rows of density and, in `[M, 4]` instead of `[M, 1]`, colour.
#[cfg(feature = "flex")]
pub(crate) fn split_density_and_color(packed: Tensor<2>) -> (Tensor<1>, Option<Tensor<2>>) {
    let color = (packed.dims()[1] > 1).then(|| packed.clone().narrow(1, 1, 3));
    (packed.narrow(1, 0, 1).squeeze_dim(1), color)
}
