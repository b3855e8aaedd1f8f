use burn::tensor::Tensor;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// Bounds the logarithms: added to A and to 1 − A.
const MARGIN: f64 = 0.1;

/// A prior that rays are either empty or opaque (Neural Volumes, Lombardi et al. 2019): the mean over the rays
/// in `rays` of `ln(0.1 + A) + ln(1.1 − A) − ln 0.1 − ln 1.1`, where A is a ray's opacity Σ w. It is 0 at A = 0
/// and A = 1, and largest at A = ½.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpacityPriorConfig {
    /// Its scheduled weight.
    pub weight: Schedule,
    /// The rays over which it is averaged.
    pub rays: RaySet,
}

impl TermSpec for OpacityPriorConfig {
    fn needs(&self) -> Vec<Need> {
        Need::of(self.rays)
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for OpacityPriorConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let at_ends = MARGIN.ln() + (1.0 + MARGIN).ln();
        renders.mean(renders.outputs(self.rays), |output| {
            let acc = output.acc.clone();
            (acc.clone() + MARGIN).log() + (acc.neg() + (1.0 + MARGIN)).log() - at_ends
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn nothing_and_opaque_are_free_and_half_costs_most() {
        let config = OpacityPriorConfig { weight: 1.0.into(), rays: RaySet::Seen };
        let value = |tau: f32| config.value(&testing::renders(&[&[tau]])).into_scalar::<f32>();
        approx::assert_abs_diff_eq!(value(0.0), 0.0, epsilon = 1e-6);
        approx::assert_abs_diff_eq!(value(f32::INFINITY), 0.0, epsilon = 1e-6);
        // ln(0.6² / 0.11).
        approx::assert_abs_diff_eq!(value(std::f32::consts::LN_2), 1.185_624, epsilon = 1e-5);
        assert!(value(0.3) < value(std::f32::consts::LN_2) && value(3.0) < value(std::f32::consts::LN_2));
    }
}
