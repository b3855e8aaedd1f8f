use burn::tensor::{Device, Tensor};
use infonerf_ops::means::mask_above;
use infonerf_ops::ray_entropy;
use infonerf_render::RenderOutput;
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, RaySet, Renders};
use crate::term::{Term, TermSpec};

/// Ray entropy minimisation (InfoNeRF, Sec. 4.2): M(r)·H(r) in bits, mean over the rays in `rays`. Masked rays count as 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EntropyConfig {
    /// λ₁.
    pub weight: Schedule,
    /// The rays over which the term is averaged (paper: all; released code: unseen).
    pub rays: RaySet,
    /// Whether neighbours of seen rays and, if `rays` includes them, of unseen rays are included, as in the released code.
    pub neighbours: bool,
    /// M(r): which rays hit something.
    pub mask: HitMask,
    /// ε inside the logarithm (released code: 1e-10); 0 is exact.
    pub epsilon: f32,
}

/// Mask M(r): 1 for rays that hit something (InfoNeRF, Eq. 6), else 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HitMask {
    /// Measure of a ray that is compared with the threshold.
    pub rule: HitRule,
    /// Threshold of the measure, above which a ray hits something; with 0 every ray that meets matter counts.
    pub threshold: f32,
}

/// The measure that decides whether a ray hits something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HitRule {
    /// Accumulated opacity Σ T α, as in the released code.
    Acc,
    /// Cumulative ray density Q = Σ α, as in the paper (Eq. 7).
    AlphaSum,
}

impl EntropyConfig {
    fn rays_with_neighbours(&self) -> RaySet {
        if self.rays.unseen() { RaySet::All } else { RaySet::Seen }
    }

    /// Computes M(r)·H(r) of each ray in bits (InfoNeRF, Eq. 5 and 6), `[R]`. The mask has no gradient.
    pub fn of_rays(&self, output: &RenderOutput) -> Tensor<1> {
        let entropy = ray_entropy(output.tau.clone(), output.segments(), self.epsilon);
        let measure = match self.mask.rule {
            HitRule::Acc => output.acc.clone(),
            HitRule::AlphaSum => entropy.alpha_sum,
        };
        mask_above(entropy.bits, measure, self.mask.threshold)
    }
}

impl TermSpec for EntropyConfig {
    fn needs(&self) -> Vec<Need> {
        if self.neighbours { Need::neighbours_of(self.rays_with_neighbours()) } else { Need::of(self.rays) }
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(0.0..=0.01, "epsilon", self.epsilon)?;
        Fault::unless_within(0.0..=1e6, "mask.threshold", self.mask.threshold)
    }

    fn build(&self, _scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for EntropyConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let pairs = renders.pairs(self.rays_with_neighbours());
        let neighbours = pairs.filter(|_| self.neighbours).map(|(_, near)| near);
        let outputs = renders.outputs(self.rays).chain(neighbours);
        renders.mean(outputs.map(|output| self.of_rays(output)))
    }
}

#[cfg(test)]
mod tests {
    use infonerf_ops::to_host;
    use infonerf_oracle::{alpha_sum, entropy, opacity};

    use super::*;
    use crate::testing::{Depths, NEAR_SEEN, NEAR_UNSEEN, SEEN, UNSEEN, check, config, mean, scenario};

    fn entropy_term(settings: &str) -> EntropyConfig {
        config(&format!("entropy = {{ {settings} }}")).entropy
    }

    /// Checks that the mean is over the rays of all bundles together, not over the bundles' means; masked rays count as 0.
    #[test]
    fn masked_entropy_over_all_rays() {
        type Measure = fn(&[f64]) -> f64;
        let rules: [(&str, Measure); 2] = [("acc", opacity), ("alpha-sum", alpha_sum)];
        for (rule, measure) in rules {
            for (rays, bundles) in [("seen", &[SEEN][..]), ("unseen", &[UNSEEN]), ("all", &[SEEN, UNSEEN])] {
                // Between the opacities of the thin ray and of the others, and above Σα of one of them.
                for threshold in [0.1, 0.8] {
                    let mask = format!("mask = {{ rule = '{rule}', threshold = {threshold} }}");
                    let term = entropy_term(&format!("rays = '{rays}', epsilon = 1e-3, {mask}"));
                    let formula = |ray: &[f64]| {
                        let hits = measure(ray) > threshold;
                        if hits { entropy(ray, 1e-3f32.into()) } else { 0.0 }
                    };
                    let of_bundles = |d: &Depths<f64>| mean(bundles.iter().flat_map(|bundle| &d[*bundle]), formula);
                    check(&term, of_bundles);
                }
            }
        }
        let (_, renders) = scenario(&Device::flex());
        let term = entropy_term("rays = 'seen', mask = { rule = 'acc', threshold = 0.1 }");
        let of_rays = to_host(term.of_rays(&renders.seen.fine));
        assert!(of_rays[1] == 0.0 && of_rays[3] == 0.0 && of_rays[0] > 1.0 && of_rays[2] > 0.1, "{of_rays:?}");
    }

    /// With rays of unseen poses, as in the released code: unseen rays, and the neighbours of seen and of unseen ones.
    #[test]
    fn neighbours_of_seen_rays_join_the_unseen_rays() {
        for (rays, bundles, needs) in [
            ("all", &[SEEN, UNSEEN, NEAR_SEEN, NEAR_UNSEEN][..], 3),
            ("unseen", &[UNSEEN, NEAR_SEEN, NEAR_UNSEEN], 3),
            ("seen", &[SEEN, NEAR_SEEN], 1),
        ] {
            let mask = "mask = { rule = 'acc', threshold = 0 }";
            let term = entropy_term(&format!("rays = '{rays}', neighbours = true, {mask}"));
            assert_eq!(term.needs().len(), needs);
            let epsilon = f64::from(term.epsilon);
            check(&term, |d| mean(bundles.iter().flat_map(|bundle| &d[*bundle]), |ray| entropy(ray, epsilon)));
        }
    }
}
