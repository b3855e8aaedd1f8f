use burn::tensor::Tensor;
use infonerf_ops::Composite;
use serde::{Deserialize, Serialize};

use crate::RaySet;

/// Ray entropy minimisation (InfoNeRF, Sec. 4.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EntropyConfig {
    /// λ₁; 0 switches the term off, and nothing is computed for it.
    pub weight: f32,
    /// Which rays count (paper: all; released code: unseen).
    pub rays: RaySet,
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
}

impl HitMask {
    /// M(r) ∈ {0, 1} of each ray, `[R]`, without a gradient.
    pub fn apply(&self, composite: &Composite) -> Tensor<1> {
        let measure = match self.rule {
            HitRule::Acc => &composite.acc,
            HitRule::AlphaSum => &composite.alpha_sum,
        };
        measure.clone().detach().greater_elem(self.threshold).float()
    }
}

/// Σ M(r) ⊙ H(r) over a bundle in bits (the sum in InfoNeRF, Eq. 8); a scalar. Divide by the number of *all* rays: those that are masked
/// count as 0.
pub fn entropy_loss(composite: &Composite, mask: HitMask) -> Tensor<1> {
    (composite.entropy.clone() * mask.apply(composite)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Tensor};
    use infonerf_ops::{Segments, composite};

    /// Two rays: two equal opaque samples (1 bit), and one that hits nothing.
    #[test]
    fn masked_rays_count_as_zero() {
        let device = Device::flex();
        let tau = Tensor::<1>::from_floats([3.0, 3.0, 1e-4, 1e-4], &device);
        let values = Tensor::<2>::zeros([4, 1], &device);
        let composite = composite(tau, values, &Segments::uniform(2, 2), Some(0.0));
        for rule in [HitRule::Acc, HitRule::AlphaSum] {
            let loss = entropy_loss(&composite, HitMask { rule, threshold: 0.1 });
            approx::assert_abs_diff_eq!(loss.into_scalar::<f32>(), 1.0, epsilon = 1e-6);
        }
    }
}
