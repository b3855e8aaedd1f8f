use burn::tensor::Tensor;
use infonerf_ops::means::mean_squared_difference;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::objective::scaled;
use crate::{Need, Renders, Term, TermSetup, TermSpec};

/// L_RGB (InfoNeRF, Eq. 3): mean over the rays of training images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotometricConfig {
    /// Its scheduled weight.
    pub weight: Schedule,
    /// The norm of colour differences.
    pub norm: Norm,
    /// Weight of the coarse pass relative to the fine one (NeRF: 1, mip-NeRF: 0.1).
    pub coarse: f32,
}

/// The norm of colour differences.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Norm {
    /// Mean over rays of ‖C − Ĉ‖², as in the paper (Eq. 3).
    Squared,
    /// Mean over rays and channels, a third of it, as in the released code, to which λ₁ and λ₂ are calibrated.
    Mean,
}

impl TermSpec for PhotometricConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::SeenColor]
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(0.0..=1e6, "coarse", self.coarse.into())
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for PhotometricConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let fine = renders.squared_error.clone().expect("colour was asked for");
        let fine = self.norm.of_mean(fine);
        let Some(coarse) = &renders.seen.passes.coarse else { return fine };
        let target = &renders.seen.target.as_ref().expect("training images show colours").rgb;
        let color = coarse.color.clone().expect("colour was asked for");
        fine + scaled(photometric_loss(color, target.clone(), self.norm), self.coarse)
    }
}

impl Norm {
    /// The loss, given its mean over rays and channels.
    fn of_mean(self, mean: Tensor<1>) -> Tensor<1> {
        match self {
            Self::Mean => mean,
            Self::Squared => mean * 3.0,
        }
    }
}

/// L_RGB of rendered `color` against `target`, both `[R, 3]` in [0, 1] (InfoNeRF, Eq. 3); a scalar.
pub fn photometric_loss(color: Tensor<2>, target: Tensor<2>, norm: Norm) -> Tensor<1> {
    norm.of_mean(mean_squared_difference(color, target))
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
