//! What follows a layer's matrix product.

use burn::tensor::{Tensor, activation};

use crate::dispatch::dispatch;

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

    /// The function of y + b, `[M, N]` and `[N]`.
    pub(super) fn of_biased(self, y: Tensor<2>, bias: Tensor<1>) -> Tensor<2> {
        dispatch! {
            &y.device();
            host => self.apply(y + bias.unsqueeze()),
            cube if y.dims()[0] > 0 => crate::cube::activation(y, bias, self),
            plain => self.apply(y + bias.unsqueeze()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{from_host, to_host};
    use burn::tensor::Device;

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
            let y = from_host(&[-2.0, 1.0], 1, &device);
            let bias = Tensor::<1>::from_floats([1.0], &device).require_grad();
            let out = function.of_biased(y, bias.clone());
            let slopes = to_host(bias.grad(&out.clone().sum().backward()).unwrap());
            for (found, want) in to_host(out).into_iter().zip(values).chain([(slopes[0], slope)]) {
                approx::assert_abs_diff_eq!(found, want, epsilon = 1e-6);
            }
        }
    }
}
