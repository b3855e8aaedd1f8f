use burn::tensor::Tensor;
use infonerf_ops::{RayDistribution, ray_entropy};
use infonerf_render::RenderOutput;
use infonerf_schedule::Schedule;
use serde::{Deserialize, Serialize};

use crate::term::in_range;
use crate::{LossError, Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// Ray entropy minimisation (InfoNeRF, Sec. 4.2): M(r)·H(r) in bits, mean over all rays that it is taken over. Rays that
/// are masked out count as 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EntropyConfig {
    /// λ₁.
    pub weight: Schedule,
    /// Which rays it is taken over (paper: all; released code: unseen).
    pub rays: RaySet,
    /// Whether it is taken over the neighbours of these rays as well, as in the released code where its KL loss is on.
    pub neighbours: bool,
    /// Which distribution along the ray the entropy is of.
    pub distribution: RayDistribution,
    /// Which rays hit something.
    pub mask: HitMask,
    /// ε inside the logarithm (released code: 1e-10); 0 is exact.
    pub epsilon: f32,
}

/// Tells the rays that hit something from those that do not (InfoNeRF, Eq. 6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HitMask {
    /// What is compared with the threshold.
    pub rule: HitRule,
    /// A ray counts if it is above this.
    pub threshold: f32,
}

/// What says that a ray hits something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HitRule {
    /// Accumulated opacity Σ T α, as in the released code.
    Acc,
    /// Cumulative ray density Q = Σ α, as in the paper (Eq. 7).
    AlphaSum,
    /// Nothing: every ray counts. For distributions that have the background in them.
    All,
}

impl TermSpec for EntropyConfig {
    fn weight(&self) -> &Schedule {
        &self.weight
    }

    fn weight_mut(&mut self) -> &mut Schedule {
        &mut self.weight
    }

    fn validate(&self) -> Result<(), LossError> {
        in_range("epsilon", self.epsilon.into(), 0.0, 0.01)?;
        in_range("mask.threshold", self.mask.threshold.into(), 0.0, 1e6)
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, LossError> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for EntropyConfig {
    fn needs(&self) -> Vec<Need> {
        if self.neighbours { Need::neighbours_of(self.rays) } else { Need::of(self.rays) }
    }

    fn value(&self, renders: &Renders) -> Tensor<1> {
        let neighbours = renders.neighbours(self.rays).filter(|_| self.neighbours);
        renders.mean(renders.outputs(self.rays).chain(neighbours), |output| {
            masked_entropy(output, self.distribution, self.mask, self.epsilon)
        })
    }
}

/// M(r)·H(r) of each ray in bits (InfoNeRF, Eq. 5 and 6), `[R]`. The mask has no gradient.
pub fn masked_entropy(output: &RenderOutput, distribution: RayDistribution, mask: HitMask, epsilon: f32) -> Tensor<1> {
    let entropy = ray_entropy(output.tau.clone(), output.segments(), distribution, epsilon);
    let measure = match mask.rule {
        HitRule::Acc => output.acc.clone(),
        HitRule::AlphaSum => entropy.alpha_sum,
        HitRule::All => return entropy.bits,
    };
    entropy.bits * measure.detach().greater_elem(mask.threshold).float()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// Two equal opaque samples (1 bit), and a ray that hits nothing.
    #[test]
    fn masked_rays_count_as_zero() {
        let renders = testing::renders(&[&[3.0, 3.0], &[1e-4, 1e-4]]);
        for (rule, bits) in [(HitRule::Acc, 0.5), (HitRule::AlphaSum, 0.5), (HitRule::All, 1.0)] {
            let config = EntropyConfig {
                weight: 1.0.into(),
                rays: RaySet::Seen,
                neighbours: false,
                distribution: RayDistribution::Alpha,
                mask: HitMask { rule, threshold: 0.1 },
                epsilon: 0.0,
            };
            approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), bits, epsilon = 1e-6);
        }
    }

    /// The mean is over the rays of all bundles together, not over their means.
    #[test]
    fn the_mean_is_over_all_rays() {
        let mut renders = testing::renders(&[&[3.0, 3.0]]);
        renders.unseen = Some(testing::renders(&[&[3.0], &[3.0], &[3.0]]).seen);
        let config = EntropyConfig {
            weight: 1.0.into(),
            rays: RaySet::All,
            neighbours: false,
            distribution: RayDistribution::Alpha,
            mask: HitMask { rule: HitRule::Acc, threshold: 0.1 },
            epsilon: 0.0,
        };
        approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), 0.25, epsilon = 1e-6);
    }
}
