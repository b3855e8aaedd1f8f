use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// How a colour difference becomes a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Norm {
    /// Mean over rays of the squared norm ‖C − Ĉ‖², as the paper writes (Eq. 3).
    Squared,
    /// Mean over rays and channels, a third of it, as the released code has it: λ₁ and λ₂ are calibrated to this one.
    Mean,
}

/// L_RGB of rendered `color` against `target`, both `[R, 3]` in [0, 1] (InfoNeRF, Eq. 3); a scalar.
pub fn photometric_loss(color: Tensor<2>, target: Tensor<2>, norm: Norm) -> Tensor<1> {
    let mean = (color - target).square().mean();
    match norm {
        Norm::Mean => mean,
        Norm::Squared => mean * 3.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn both_norms_by_hand() {
        let device = Device::flex();
        let color = Tensor::<2>::from_floats([[0.1, 0.2, 0.3], [1.0, 1.0, 1.0]], &device);
        let target = Tensor::<2>::from_floats([[0.0, 0.0, 0.0], [1.0, 1.0, 0.5]], &device);
        let squared = (0.01 + 0.04 + 0.09 + 0.25) / 2.0;
        let value = |norm| photometric_loss(color.clone(), target.clone(), norm).into_scalar::<f32>();
        approx::assert_abs_diff_eq!(value(Norm::Squared), squared, epsilon = 1e-6);
        approx::assert_abs_diff_eq!(value(Norm::Mean), squared / 3.0, epsilon = 1e-6);
    }
}
