use burn::tensor::Tensor;
use infonerf_field::Penalty;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, Renders};
use crate::term::{Term, TermSetup, TermSpec};

/// Divergence of a field's latent code from a standard normal distribution (Neural Volumes, Lombardi et al. 2019): the mean
/// over the code's elements of `KL(N(μ, σ²) ‖ N(0, 1)) = ½(μ² + σ² − 1) − ln σ`, in nats; 0 for a field without a latent code.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatentConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
}

impl TermSpec for LatentConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::Penalty(Penalty::LATENT_DIVERGENCE)]
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for LatentConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        renders.penalty(Penalty::LATENT_DIVERGENCE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{config, scenario};

    #[test]
    fn the_value_is_the_fields_penalty_or_zero() {
        let (_, mut renders) = scenario(&burn::tensor::Device::flex());
        let value = |renders: &Renders| config("").latent.value(renders).into_scalar::<f32>();
        assert_eq!(value(&renders), 0.0);
        renders.penalties.insert(Penalty::LATENT_DIVERGENCE, renders.zero() + 3.0);
        assert_eq!(value(&renders), 3.0);
    }
}
