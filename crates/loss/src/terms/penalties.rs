//! Penalties on a field's own parameters.

use burn::tensor::{Device, Tensor};
use infonerf_field::Penalty;
use infonerf_ops::means::weighted_sum;
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, Renders};
use crate::term::{Term, TermSpec};

/// Total variation of a field's tables (planes, grids), as the field defines its mean; 0 for a field without tables.
///
/// A log-prior is added to a sum over all observed pixels. L_RGB is a mean over them, so that the weight of the same prior is
/// inversely proportional to the number of training views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TvConfig {
    /// Scheduled weight of the term. A falling weight lets detail appear late in the run.
    pub weight: Schedule,
    /// Number of training views for which `weight` is meant: the weight is multiplied by `views` over the number of
    /// training views. 0 leaves the weight unchanged.
    pub views: u32,
}

/// Divergence of a field's latent code from a standard normal distribution (Neural Volumes, Lombardi et al. 2019): the mean
/// over the code's elements of `KL(N(μ, σ²) ‖ N(0, 1)) = ½(μ² + σ² − 1) − ln σ`, in nats; 0 for a field without a latent code.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatentConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
}

impl TermSpec for TvConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::Penalty(Penalty::TOTAL_VARIATION)]
    }

    fn build(&self, scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        let factor = factor(self.views, scene.train.len());
        Ok(Box::new(PenaltyTerm { name: Penalty::TOTAL_VARIATION, factor }))
    }
}

impl TermSpec for LatentConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::Penalty(Penalty::LATENT_DIVERGENCE)]
    }

    fn build(&self, _scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(PenaltyTerm { name: Penalty::LATENT_DIVERGENCE, factor: 1.0 }))
    }
}

struct PenaltyTerm {
    name: Penalty,
    factor: f32,
}

impl Term for PenaltyTerm {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        // There is no product if the factor is 1: on a GPU it would be a kernel launch in each direction.
        weighted_sum(vec![(renders.penalty(self.name), self.factor)]).expect("one value")
    }
}

/// Returns `meant`/`trained`; 1 if `meant` is 0.
fn factor(meant: u32, trained: usize) -> f32 {
    if meant == 0 { 1.0 } else { (f64::from(meant) / trained.max(1) as f64) as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::scenario;

    #[test]
    fn value_is_the_fields_penalty_or_zero_and_halved_for_twice_as_many_views() {
        assert_eq!([factor(4, 2), factor(4, 4), factor(4, 8), factor(0, 8)], [2.0, 1.0, 0.5, 1.0]);
        for (name, factor) in [(Penalty::TOTAL_VARIATION, 0.5), (Penalty::LATENT_DIVERGENCE, 1.0)] {
            let (_, mut renders) = scenario(&Device::flex());
            let term = PenaltyTerm { name, factor };
            assert_eq!(term.value(&renders).into_scalar::<f32>(), 0.0);
            renders.penalties.insert(name, renders.zero() + 3.0);
            assert_eq!(term.value(&renders).into_scalar::<f32>(), 3.0 * factor);
        }
    }
}
