//! Distributions along rays on the host, in `f64` and without cancellation, for ray entropy and the divergence of
//! neighbouring rays.
//!
//! Training drives rays towards one surface, and neighbouring rays towards equal distributions. Entropy and divergence
//! are then differences of nearly equal numbers, which would lose all digits in `f32`.

use std::ops::Range;

use super::numeric::SampleOpacity;
use super::rays::Group;
use crate::entropy::MIN_ALPHA_SUM;

/// Distributions p = α/Σα of the rays of a group.
pub(crate) struct Distributions {
    pub(crate) opacity: SampleOpacity,
    /// Probability of each packed sample; 0 along a ray that hits nothing.
    pub(crate) p: Vec<f64>,
    pub(crate) rays: Vec<RayMasses>,
}

/// Sums of the *masses* along one ray: the opacities, which are the probabilities before normalisation.
pub(crate) struct RayMasses {
    pub(crate) range: Range<usize>,
    /// Index of the sample with the largest mass.
    pub(crate) top: usize,
    /// Sum of all masses but the largest, kept separately: it may be below the last digit of `sum`.
    pub(crate) rest: f64,
    pub(crate) sum: f64,
}

impl RayMasses {
    /// Sums the masses of the samples in `range`.
    #[inline(always)]
    fn new(range: Range<usize>, mass: &[f64]) -> Self {
        let (mut top, mut most, mut rest) = (range.start, 0.0, 0.0);
        for (i, &mass) in range.clone().zip(&mass[range.clone()]) {
            let above = mass > most;
            rest += if above { most } else { mass };
            (top, most) = if above { (i, mass) } else { (top, most) };
        }
        Self { range, top, rest, sum: most + rest }
    }

    /// Returns whether the masses sum to at least [`MIN_ALPHA_SUM`]. A NaN counts as such a sum, so that it reaches the result.
    pub(crate) fn hits(&self) -> bool {
        self.sum.is_nan() || self.sum >= f64::from(MIN_ALPHA_SUM)
    }
}

impl Distributions {
    /// Computes the distributions of samples with optical depths `tau`.
    #[inline(always)]
    pub(crate) fn new<const FMA: bool>(tau: &[f32], group: &Group<'_>) -> Self {
        let opacity = SampleOpacity::new::<FMA>(tau);
        let rays: Vec<RayMasses> = group.ranges().map(|range| RayMasses::new(range, &opacity.alpha)).collect();
        let mut p = opacity.alpha.clone();
        for masses in &rays {
            let scale = if masses.hits() { 1.0 / masses.sum } else { 0.0 };
            p[masses.range.clone()].iter_mut().for_each(|p| *p *= scale);
        }
        Self { opacity, p, rays }
    }

    /// Calls `put(i, ∂L/∂τᵢ)` for the samples of `ray`, which hits something: ∂L/∂τᵢ = (gᵢ − Σ pⱼ gⱼ)/S · e^−τᵢ, given
    /// gᵢ = ∂L/∂pᵢ (`dp`) and p = α/S. A constant in all gᵢ cancels, so the gᵢ of the largest mass is subtracted first.
    #[inline(always)]
    pub(crate) fn through_normalisation(&self, ray: usize, dp: &[f64], mut put: impl FnMut(usize, f64)) {
        let RayMasses { range, top, sum, .. } = &self.rays[ray];
        let common = dp[*top];
        let mean: f64 = range.clone().map(|i| self.p[i] * (dp[i] - common)).sum();
        let scale = 1.0 / sum;
        for i in range.clone() {
            put(i, (dp[i] - common - mean) * scale * self.opacity.transmittance[i]);
        }
    }
}
