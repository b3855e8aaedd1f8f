use burn::tensor::{Device, Tensor};
use infonerf_ops::means::{mean_squared_difference, weighted_sum};
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, Renders};
use crate::term::{Term, TermSpec};

/// L_RGB (InfoNeRF, Eq. 3): mean over the rays of training images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotometricConfig {
    /// Scheduled weight of the term.
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
    /// Mean over rays and channels, a third of [`Norm::Squared`], as in the released code, for which λ₁ and λ₂ are chosen.
    Mean,
}

impl TermSpec for PhotometricConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::SeenColor]
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(0.0..=1e6, "coarse", self.coarse)
    }

    fn build(&self, _scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for PhotometricConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let fine = renders.squared_error.clone().expect("colour is needed");
        let fine = self.norm.of_mean(fine);
        let Some(coarse) = &renders.seen.coarse else { return fine };
        let color = coarse.color.clone().expect("colour is needed");
        let coarse = photometric_loss(color, renders.target.rgb.clone(), self.norm);
        weighted_sum(vec![(fine, 1.0), (coarse, self.coarse)]).expect("two values")
    }
}

impl Norm {
    /// Returns the loss, given its mean over rays and channels.
    fn of_mean(self, mean: Tensor<1>) -> Tensor<1> {
        match self {
            Self::Mean => mean,
            Self::Squared => mean * 3.0,
        }
    }
}

/// Computes L_RGB of rendered `color` against `target`, both `[R, 3]` in [0, 1] (InfoNeRF, Eq. 3); a scalar.
pub fn photometric_loss(color: Tensor<2>, target: Tensor<2>, norm: Norm) -> Tensor<1> {
    norm.of_mean(mean_squared_difference(color, target))
}

#[cfg(test)]
mod tests {
    use infonerf_oracle::weights;

    use super::*;
    use crate::testing::{COARSE, PIXELS, SEEN, check, check_with, color, config};

    /// Mean over rays of ‖C − Ĉ‖².
    fn squared(rays: &[Vec<f64>]) -> f64 {
        let error = |(ray, pixel): (&Vec<f64>, [f64; 3])| -> f64 {
            let w = weights(ray);
            let shown = |c: usize| w.iter().enumerate().map(|(i, w)| w * color(i)[c]).sum::<f64>();
            (0..3).map(|c| (shown(c) - pixel[c]).powi(2)).sum()
        };
        rays.iter().zip(PIXELS).map(error).sum::<f64>() / rays.len() as f64
    }

    #[test]
    fn squared_errors_of_both_passes_are_added() {
        for (norm, channels) in [("squared", 1.0), ("mean", 3.0)] {
            for coarse in [0.0, 0.1, 1.0] {
                let term = config(&format!("rgb = {{ norm = '{norm}', coarse = {coarse:?} }}")).rgb;
                let weight = f64::from(coarse as f32);
                check(&term, |d| (squared(&d[SEEN]) + weight * squared(&d[COARSE])) / channels);
                let single = |renders: &mut Renders| renders.seen.coarse = None;
                check_with(&term, single, |d| squared(&d[SEEN]) / channels);
            }
        }
    }
}
