//! What follows a layer's matrix product.

use burn::tensor::{Tensor, activation};

/// A function of each number.
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
    /// The function of each number of `x`.
    pub fn apply<const D: usize>(self, x: Tensor<D>) -> Tensor<D> {
        match self {
            Self::None => x,
            Self::Relu => activation::relu(x),
            Self::ShiftedSoftplus => activation::softplus(x - 1.0, 1.0),
            Self::Sigmoid => activation::sigmoid(x),
        }
    }
}
