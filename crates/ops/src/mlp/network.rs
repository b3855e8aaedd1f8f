//! Layers, activations and precisions of a radiance network.

use burn::tensor::{Tensor, activation};
use serde::{Deserialize, Serialize};

use crate::frequency::frequency_encode;
use crate::segments::Segments;

/// Element-wise function after a dense layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Activation {
    /// x
    None,
    /// max(x, 0)
    Relu,
    /// ln(1 + eˣ⁻¹)
    ShiftedSoftplus,
    /// 1/(1 + e⁻ˣ)
    Sigmoid,
}

impl Activation {
    /// Applies the function to each element of `x`.
    pub fn apply<const D: usize>(self, x: Tensor<D>) -> Tensor<D> {
        match self {
            Self::None => x,
            Self::Relu => activation::relu(x),
            Self::ShiftedSoftplus => activation::softplus(x - 1.0, 1.0),
            Self::Sigmoid => activation::sigmoid(x),
        }
    }
}

/// Precision of the factors of a network's matrix products. Weights, sums and everything else are single precision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision; CUDA's tensor cores may round factors to TensorFloat-32 (11 significant bits).
    #[default]
    F32,
    /// Factors rounded to bfloat16 (8 significant bits, the exponents of single precision, so that gradients need no scaling):
    /// the products that AMX, AVX512_BF16 and the tensor cores of GPUs are fast at. On `flex` a forward pass then keeps no
    /// activations, because the backward pass computes them again; GPUs also round the results of products.
    Bf16,
}

/// Dense layer y = x W + b.
#[derive(Clone, Debug)]
pub struct Dense {
    /// W, `[inputs, outputs]`.
    pub weight: Tensor<2>,
    /// b, `[outputs]`.
    pub bias: Tensor<1>,
}

/// Network of NeRF: encoded position → trunk of ReLU layers → density; trunk and encoded view direction → colour.
#[derive(Clone, Debug)]
pub struct RadianceMlp {
    /// ReLU layers, each reading the output of the one before.
    pub trunk: Vec<Dense>,
    /// Index of the trunk layer that reads the encoded position in front of its other inputs; 0 for none.
    pub skip: usize,
    /// Layer from the trunk to density.
    pub sigma: Dense,
    /// Layers from the trunk to colour; `None` computes density alone.
    pub color: Option<ColorBranch>,
    /// Precision of the matrix products.
    pub precision: Precision,
}

impl RadianceMlp {
    /// Iterates over the layers in the order in which host kernels take their parameters: trunk, feature, view, sigma, rgb.
    #[cfg(feature = "flex")]
    pub(crate) fn layers(&self) -> impl Iterator<Item = &Dense> {
        let hidden = self.color.iter().flat_map(|branch| [&branch.feature, &branch.view]);
        self.trunk.iter().chain(hidden).chain([&self.sigma]).chain(self.color.iter().map(|branch| &branch.rgb))
    }
}

/// Colour branch: trunk → features; features and encoded direction → a ReLU layer → colour.
#[derive(Clone, Debug)]
pub struct ColorBranch {
    /// Linear layer from the trunk to features.
    pub feature: Dense,
    /// ReLU layer that reads features, then the encoded direction.
    pub view: Dense,
    /// Layer to red, green and blue.
    pub rgb: Dense,
    /// Unit direction of each ray, `[R, 3]`; it receives no gradient.
    pub directions: Tensor<2>,
    /// Frequencies of the encoding of directions.
    pub frequencies: usize,
    /// Samples of each ray.
    pub segments: Segments,
}

impl ColorBranch {
    pub(crate) fn encoded_directions(&self) -> Tensor<2> {
        frequency_encode(self.directions.clone().detach(), self.frequencies, &[])
    }
}
