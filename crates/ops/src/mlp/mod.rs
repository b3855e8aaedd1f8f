//! The layers that NeRF and mip-NeRF share (Mildenhall et al. 2020, Fig. 7), as one operation.

mod activation;
mod plain;

#[cfg(feature = "flex")]
mod host;
#[cfg(feature = "flex")]
mod rounded;

pub use activation::Activation;
pub use plain::plain;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::dispatch::dispatch;
use crate::{Segments, frequency_encode};

/// How exact a network's matrix products are. Weights, sums of products and everything else are single precision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// Factors rounded to 11 significant bits (TensorFloat-32) where a GPU's tuning finds its tensor cores faster.
    Tf32,
    /// Factors rounded to bfloat16, which has 8 bits and the exponents of single precision, so that gradients need no scaling:
    /// the products that AMX, AVX512_BF16 and the tensor cores of GPUs are fast at. On the host a forward pass then keeps no
    /// activations, as the backward one computes them again; GPUs round the products' results too.
    Bf16,
}

/// A layer y = xW + b.
#[derive(Clone, Debug)]
pub struct Dense {
    /// W, `[inputs, outputs]`.
    pub weight: Tensor<2>,
    /// b, `[outputs]`.
    pub bias: Tensor<1>,
}

/// Encoded position → trunk of ReLU layers → density; trunk and encoded view direction → colour.
#[derive(Clone, Debug)]
pub struct RadianceMlp {
    /// ReLU layers, each but the first on top of the one before.
    pub trunk: Vec<Dense>,
    /// The layer of the trunk that is given the encoded position too, before its other inputs; 0 for none.
    pub skip: usize,
    /// From the trunk to density.
    pub sigma: Dense,
    /// The way to colour, if colour is wanted.
    pub color: Option<ColorBranch>,
    /// Of the matrix products.
    pub precision: Precision,
}

/// Trunk → features; features and encoded direction → a ReLU layer → colour.
#[derive(Clone, Debug)]
pub struct ColorBranch {
    /// A linear layer.
    pub feature: Dense,
    /// A ReLU layer of features, then direction.
    pub view: Dense,
    /// From there to red, green and blue.
    pub rgb: Dense,
    /// Unit direction of each ray, `[R, 3]`. It has no gradient.
    pub directions: Tensor<2>,
    /// Frequencies of its encoding.
    pub frequencies: usize,
    /// Which samples belong to which ray.
    pub segments: Segments,
}

impl ColorBranch {
    pub(crate) fn encoded_directions(&self) -> Tensor<2> {
        frequency_encode(self.directions.clone().detach(), self.frequencies, &[])
    }
}

/// What the network says of encoded positions `[M, E]`, before activation: `[M, 4]` of (σ, r, g, b), or `[M, 1]` of σ
/// where `network` has no colour. Differentiable in every weight and in `encoded`.
///
/// # Panics
/// If the layers do not fit on top of each other, or the device does not have numbers of that precision.
pub fn radiance_mlp(encoded: Tensor<2>, network: &RadianceMlp) -> Tensor<2> {
    dispatch! {
        &encoded.device();
        host => match network.precision {
            Precision::F32 | Precision::Tf32 => on_host(host::MlpKernel::new(encoded.dims(), network), encoded, network),
            Precision::Bf16 => on_host(rounded::RoundedKernel::new(encoded.dims(), network), encoded, network),
        },
        cube => match on_gpu(encoded, network, [Activation::None; 2]) {
            (sigma, Some(color)) => Tensor::cat(vec![sigma, color], 1),
            (sigma, None) => sigma,
        },
        plain => plain(encoded, network),
    }
}

/// Density `[M, 1]` and colour `[M, 3]`, after `functions` of each.
#[cfg(feature = "cube")]
fn on_gpu(encoded: Tensor<2>, network: &RadianceMlp, functions: [Activation; 2]) -> (Tensor<2>, Option<Tensor<2>>) {
    let is_fused = network.precision == Precision::F32 && encoded.dims()[0] > 0 && !network.trunk.is_empty();
    if is_fused {
        crate::cube::radiance(encoded, network, functions)
    } else {
        plain::layers(encoded, network, functions)
    }
}

/// A kernel of x, all weights and encoded directions.
#[cfg(feature = "flex")]
fn on_host(
    (kernel, weights): (impl crate::kernel::Kernel, Tensor<1>),
    encoded: Tensor<2>,
    network: &RadianceMlp,
) -> Tensor<2> {
    match &network.color {
        Some(branch) => crate::kernel::apply(kernel, (encoded, weights, branch.encoded_directions())),
        None => crate::kernel::apply(kernel, (encoded, weights)),
    }
}

/// Density `[M]`, after its activation, and colour `[M, 3]`, after a sigmoid, where the network has it: see [`radiance_mlp`].
///
/// # Panics
/// As [`radiance_mlp`].
pub fn density_and_color(
    encoded: Tensor<2>,
    network: &RadianceMlp,
    density: Activation,
) -> (Tensor<1>, Option<Tensor<2>>) {
    let split = |raw: Tensor<2>| {
        let color = network.color.as_ref().map(|_| Activation::Sigmoid.apply(raw.clone().narrow(1, 1, 3)));
        (density.apply(raw.narrow(1, 0, 1).squeeze_dim(1)), color)
    };
    dispatch! {
        &encoded.device();
        host => split(radiance_mlp(encoded, network)),
        cube => {
            let (density, color) = on_gpu(encoded, network, [density, Activation::Sigmoid]);
            (density.squeeze_dim(1), color)
        },
        plain => split(radiance_mlp(encoded, network)),
    }
}
