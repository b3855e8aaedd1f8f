use burn::tensor::{Device, Tensor};
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, RaySet, Renders};
use crate::term::{Term, TermSpec};

/// Value added to A and to 1 − A, which bounds the logarithms.
const MARGIN: f64 = 0.1;

/// A prior that rays are either empty or opaque (Neural Volumes, Lombardi et al. 2019): the mean over the rays in `rays` of
/// `ln(0.1 + A) + ln(1.1 − A) − ln 0.1 − ln 1.1`, where A is a ray's opacity Σ w: 0 at A = 0 and A = 1, and largest at A = ½.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpacityPriorConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
    /// The rays over which the term is averaged.
    pub rays: RaySet,
}

impl TermSpec for OpacityPriorConfig {
    fn needs(&self) -> Vec<Need> {
        Need::of(self.rays)
    }

    fn build(&self, _scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for OpacityPriorConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let at_ends = MARGIN.ln() + (1.0 + MARGIN).ln();
        renders.mean(renders.outputs(self.rays).map(|output| {
            let acc = output.acc.clone();
            (acc.clone() + MARGIN).log() + (acc.neg() + (1.0 + MARGIN)).log() - at_ends
        }))
    }
}

#[cfg(test)]
mod tests {
    use infonerf_oracle::opacity;

    use crate::testing::{SEEN, UNSEEN, check, config, mean};

    #[test]
    fn prior_is_zero_at_both_ends_and_highest_between() {
        let prior = |a: f64| ((0.1 + a) * (1.1 - a) / 0.11).ln();
        assert_eq!([prior(0.0), prior(1.0)].map(|x| (x * 1e12).round()), [0.0, 0.0]);
        assert!(prior(0.5) > prior(0.4) && prior(0.5) > prior(0.6));
        let term = config("opacity_prior.rays = 'all'").opacity_prior;
        check(&term, |d| mean(d[SEEN].iter().chain(&d[UNSEEN]), |ray| prior(opacity(ray))));
        check(&config("").opacity_prior, |d| mean(d[SEEN].iter(), |ray| prior(opacity(ray))));
    }
}
