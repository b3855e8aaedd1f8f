use burn::tensor::Tensor;
use infonerf_field::Penalty;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::objective::scaled;
use crate::renders::{Need, Renders};
use crate::term::{Term, TermSetup, TermSpec};

/// Total variation of a field's tables (planes, grids), as the field defines its mean; 0 for a field without tables.
///
/// A log-prior is added to a sum over all observed pixels. L_RGB is a mean over them, so that the weight of the same prior is
/// inversely proportional to the number of training views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TvConfig {
    /// Scheduled weight of the term. A falling weight lets detail appear late in the run.
    pub weight: Schedule,
    /// The number of training views that the weight is for: the weight is multiplied by `views` over the number of training
    /// views. With 0 it does not depend on them.
    pub views: u32,
}

/// Total variation times a factor that depends on the scene.
#[derive(Debug)]
struct Tv {
    factor: f32,
}

impl TermSpec for TvConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::Penalty(Penalty::TOTAL_VARIATION)]
    }

    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(Tv { factor: factor(self.views, setup.scene.train.len()) as f32 }))
    }
}

impl Term for Tv {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        scaled(renders.penalty(Penalty::TOTAL_VARIATION), self.factor)
    }
}

/// Returns `meant`/`trained`; 1 if `meant` is 0.
fn factor(meant: u32, trained: usize) -> f64 {
    if meant == 0 { 1.0 } else { f64::from(meant) / trained.max(1) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::scenario;

    #[test]
    fn twice_as_many_views_halve_the_value() {
        assert_eq!([factor(4, 2), factor(4, 4), factor(4, 8), factor(0, 8)], [2.0, 1.0, 0.5, 1.0]);
        let (_, mut renders) = scenario(&burn::tensor::Device::flex());
        let term = Tv { factor: factor(4, 8) as f32 };
        assert_eq!(term.value(&renders).into_scalar::<f32>(), 0.0);
        renders.penalties.insert(Penalty::TOTAL_VARIATION, renders.zero() + 3.0);
        assert_eq!(term.value(&renders).into_scalar::<f32>(), 1.5);
    }
}
