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
pub use plain::plain;
pub(crate) use plain::{dense, packed};

use burn::tensor::Tensor;

use crate::dispatch::dispatch;
#[cfg(feature = "flex")]
use crate::graph::Inputs;

/// Evaluates the network at encoded positions `[M, E]`, before activation: `[M, 4]` of (σ, r, g, b), or `[M, 1]` of σ if
/// `network` has no colour. Differentiable in every weight and in `encoded`.
///
/// # Panics
/// If the layers do not fit on top of each other, or the device lacks the precision.
pub fn radiance_mlp(encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    dispatch! {
        &encoded.device();
        host => match network.precision {
            Precision::F32 => on_host(host::MlpKernel::new(encoded.dims(), network), encoded, network),
            Precision::Bf16 => on_host(crate::bf16::RoundedMlpKernel::new(encoded.dims(), network), encoded, network),
        },
        plain => plain(encoded, network),
    }
}

/// Applies a kernel of x, the encoded direction of each ray if the network has colour, and weights and biases of each layer.
#[cfg(feature = "flex")]
fn on_host(kernel: impl crate::kernel::Kernel, encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    let shape = [encoded.dims()[0], if network.color.is_some() { 4 } else { 1 }];
    let directions = network.color.as_ref().map(|branch| branch.encoded_directions().into_dispatch());
    let parameters =
        network.layers().flat_map(|layer| [layer.weight.clone().into_dispatch(), layer.bias.clone().into_dispatch()]);
    let inputs: Inputs<burn::backend::Dispatch> =
        std::iter::once(encoded.into_dispatch()).chain(directions).chain(parameters).collect();
    crate::kernel::apply(kernel, shape, inputs)
}

/// Returns the index of the first layer's weights among the inputs of a host kernel.
#[cfg(feature = "flex")]
pub(crate) fn first_layer(has_color: bool) -> usize {
    if has_color { 2 } else { 1 }
}

/// Evaluates density `[M]`, after the activation `density`, and colour `[M, 3]`, after a sigmoid, if the network has colour.
///
/// # Panics
/// As [`radiance_mlp`].
pub fn density_and_color(
    encoded: Tensor<2>,
    network: &RadianceMlp,
    density: Activation,
) -> (Tensor<1>, Option<Tensor<2>>) {
    dispatch! {
        &encoded.device();
        host => {
            let raw = radiance_mlp(encoded, network);
            let color = network.color.as_ref().map(|_| Activation::Sigmoid.apply(raw.clone().narrow(1, 1, 3)));
            (density.apply(raw.narrow(1, 0, 1).squeeze_dim(1)), color)
        },
        plain => {
            let (density, color) = plain::heads(encoded, network, [density, Activation::Sigmoid]);
            (density.squeeze_dim(1), color)
        },
    }
}
