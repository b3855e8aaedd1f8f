use burn::tensor::Tensor;
use infonerf_schedule::Schedule;
use serde::{Deserialize, Serialize};

use crate::{LossError, Need, Renders, Term, TermSetup, TermSpec};

/// Total variation of a field's tables (planes, grids), as the field defines its mean; 0 for a field without tables.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TvConfig {
    /// Its weight. Falling over the run it lets detail come back.
    pub weight: Schedule,
}

impl TermSpec for TvConfig {
    fn weight(&self) -> &Schedule {
        &self.weight
    }

    fn weight_mut(&mut self) -> &mut Schedule {
        &mut self.weight
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, LossError> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for TvConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::TotalVariation]
    }

    fn value(&self, renders: &Renders) -> Tensor<1> {
        renders.total_variation.clone().unwrap_or_else(|| renders.zero())
    }
}
