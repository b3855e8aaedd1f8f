use burn::tensor::Tensor;
use infonerf_ops::means::{mask_above, sum_above};
use infonerf_ops::{RayDistribution, ray_entropy};
use infonerf_render::RenderOutput;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// Ray entropy minimisation (InfoNeRF, Sec. 4.2): M(r)·H(r) in bits, mean over the rays in `rays`. Masked
/// rays count as 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EntropyConfig {
    /// λ₁.
    pub weight: Schedule,
    /// The rays over which it is averaged (paper: all; released code: unseen).
    pub rays: RaySet,
    /// Whether neighbours are included: those of seen rays and, if `rays` includes unseen ones, of these, as in the released
    /// code with the KL loss.
    pub neighbours: bool,
    /// The distribution along the ray.
    pub distribution: RayDistribution,
    /// M(r): which rays hit something.
    pub mask: HitMask,
    /// ε inside the logarithm (released code: 1e-10); 0 is exact.
    pub epsilon: f32,
}

/// M(r), 1 for rays that hit something (InfoNeRF, Eq. 6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HitMask {
    /// What is compared with the threshold.
    pub rule: HitRule,
    /// Rays above it hit something.
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
    /// None: every ray counts. For distributions that include the background.
    All,
}

impl EntropyConfig {
    /// The rays whose neighbours are included.
    fn rays_with_neighbours(&self) -> RaySet {
        if self.rays.unseen() { RaySet::All } else { RaySet::Seen }
    }
}

impl TermSpec for EntropyConfig {
    fn needs(&self) -> Vec<Need> {
        match self.neighbours {
            true => Need::neighbours_of(self.rays_with_neighbours()),
            false => Need::of(self.rays),
        }
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(0.0..=0.01, "epsilon", self.epsilon.into())?;
        Fault::unless_within(0.0..=1e6, "mask.threshold", self.mask.threshold.into())
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for EntropyConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let neighbours = renders.neighbours(self.rays_with_neighbours()).filter(|_| self.neighbours);
        let outputs = renders.outputs(self.rays).chain(neighbours);
        renders.mean_of_sums(outputs.map(|output| {
            let (bits, measure) = entropy(output, self.distribution, self.mask, self.epsilon);
            let sum = match measure {
                Some(measure) => sum_above(bits, measure, self.mask.threshold),
                None => bits.sum(),
            };
            (sum, output.segments().rays())
        }))
    }
}

/// M(r)·H(r) of each ray in bits (InfoNeRF, Eq. 5 and 6), `[R]`. The mask has no gradient.
pub fn masked_entropy(output: &RenderOutput, distribution: RayDistribution, mask: HitMask, epsilon: f32) -> Tensor<1> {
    match entropy(output, distribution, mask, epsilon) {
        (bits, Some(measure)) => mask_above(bits, measure, mask.threshold),
        (bits, None) => bits,
    }
}

/// H(r) of each ray in bits, `[R]`, and what is compared with the mask's threshold, `[R]`, unless every ray counts.
fn entropy(
    output: &RenderOutput,
    distribution: RayDistribution,
    mask: HitMask,
    epsilon: f32,
) -> (Tensor<1>, Option<Tensor<1>>) {
    let entropy = ray_entropy(output.tau.clone(), output.segments(), distribution, epsilon);
    let measure = match mask.rule {
        HitRule::Acc => Some(output.acc.clone()),
        HitRule::AlphaSum => Some(entropy.alpha_sum),
        HitRule::All => None,
    };
    (entropy.bits, measure)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    fn config(rays: RaySet, rule: HitRule) -> EntropyConfig {
        let mask = HitMask { rule, threshold: 0.1 };
        let distribution = RayDistribution::Alpha;
        EntropyConfig { weight: 1.0.into(), rays, neighbours: false, distribution, mask, epsilon: 0.0 }
    }

    /// Two equal opaque samples (1 bit), and a ray that hits nothing.
    #[test]
    fn masked_rays_count_as_zero() {
        let renders = testing::renders(&[&[3.0, 3.0], &[1e-4, 1e-4]]);
        for (rule, bits) in [(HitRule::Acc, 0.5), (HitRule::AlphaSum, 0.5), (HitRule::All, 1.0)] {
            let value = config(RaySet::Seen, rule).value(&renders).into_scalar::<f32>();
            approx::assert_abs_diff_eq!(value, bits, epsilon = 1e-6);
        }
    }

    /// With rays of unseen poses, as in the released code: unseen rays, and the neighbours of seen and of unseen ones.
    #[test]
    fn neighbours_of_seen_rays_join_the_unseen_rays() {
        let mut renders = testing::renders(&[&[1e-4, 1e-4]]);
        renders.unseen = Some(testing::renders(&[&[3.0, 3.0]]).seen);
        renders.neighbours.seen = Some(testing::renders(&[&[3.0], &[3.0]]).seen.passes.fine);
        renders.neighbours.unseen = Some(testing::renders(&[&[3.0]]).seen.passes.fine);
        let config = EntropyConfig { neighbours: true, ..config(RaySet::Unseen, HitRule::Acc) };
        approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), 0.25, epsilon = 1e-6);
        assert_eq!(config.needs(), [Need::Unseen, Need::SeenNeighbours, Need::UnseenNeighbours]);
        let seen = EntropyConfig { rays: RaySet::Seen, ..config };
        assert_eq!(seen.needs(), [Need::SeenNeighbours]);
    }

    /// The mean is over the rays of all bundles together, not over their means.
    #[test]
    fn the_mean_is_over_all_rays() {
        let mut renders = testing::renders(&[&[3.0, 3.0]]);
        renders.unseen = Some(testing::renders(&[&[3.0], &[3.0], &[3.0]]).seen);
        let value = config(RaySet::All, HitRule::Acc).value(&renders).into_scalar::<f32>();
        approx::assert_abs_diff_eq!(value, 0.25, epsilon = 1e-6);
    }
}
