//! Distributions along rays on the host, in `f64` and without cancellation, for ray entropy and the divergence of
//! neighbouring rays.
//!
//! Training drives rays towards one surface, and neighbouring rays towards equal distributions. Entropy and divergence
//! are then differences of nearly equal numbers, which would lose all digits in `f32`.

use std::ops::Range;

use super::numeric::{SampleOpacity, ln, log_ratio};
use super::rays::Group;
use crate::entropy::MIN_ALPHA_SUM;

/// Distributions p = α/Σα of the rays of a group.
pub(crate) struct Distributions {
    pub(crate) opacity: SampleOpacity,
    /// Probability of each packed sample; 0 along a ray that hits nothing.
    p: Vec<f64>,
    rays: Vec<RayMasses>,
}

/// Sums of the *masses* along one ray: the opacities, which are the probabilities before normalisation.
struct RayMasses {
    range: Range<usize>,
    /// Index of the sample with the largest mass.
    top: usize,
    /// Sum of all masses but the largest, kept separately: it may be below the last digit of `sum`.
    rest: f64,
    sum: f64,
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
    fn hits(&self) -> bool {
        self.sum.is_nan() || self.sum >= f64::from(MIN_ALPHA_SUM)
    }

    /// Returns whether one mass exceeds half of the sum. Its probability is then exact to all digits as 1 − rest/sum.
    fn is_certain(&self) -> bool {
        self.hits() && 2.0 * self.rest < self.sum
    }

    /// Calls `put(i, ∂L/∂τᵢ)` with ∂L/∂τᵢ = (gᵢ − Σ pⱼ gⱼ)/S · e^−τᵢ, given gᵢ = ∂L/∂pᵢ and p = α/S. A constant in all gᵢ
    /// cancels, so the gᵢ of the largest mass is subtracted first.
    #[inline(always)]
    fn through_normalisation(
        &self,
        p: &[f64],
        transmittance: &[f64],
        dp: impl Fn(usize) -> f64,
        mut put: impl FnMut(usize, f64),
    ) {
        let common = dp(self.top);
        let mean: f64 = self.range.clone().map(|i| p[i] * (dp(i) - common)).sum();
        let scale = 1.0 / self.sum;
        for i in self.range.clone() {
            put(i, (dp(i) - common - mean) * scale * transmittance[i]);
        }
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

    /// Computes ln(p + ε) of each sample. If ε is 0, a probability counts as at least the smallest normal `f32` over the
    /// ray's sum, so that its gradient is finite.
    #[inline(always)]
    fn logs<const FMA: bool>(&self, epsilon: f64) -> Vec<f64> {
        let mut logs: Vec<f64> = self.p.iter().map(|p| p + epsilon).collect();
        if epsilon == 0.0 {
            for masses in &self.rays {
                let least = f64::from(f32::MIN_POSITIVE) / if masses.hits() { masses.sum } else { 1.0 };
                logs[masses.range.clone()].iter_mut().for_each(|p| *p = p.max(least));
            }
        }
        for log in &mut logs {
            *log = ln::<FMA>(*log);
        }
        for masses in self.rays.iter().filter(|masses| masses.is_certain()) {
            logs[masses.top] = (epsilon - masses.rest / masses.sum).ln_1p();
        }
        logs
    }

    /// Calls `put` with each ray's index and H = −Σ p ln(p + ε) in nats; 0 for a ray that hits nothing.
    #[inline(always)]
    pub(crate) fn entropies<const FMA: bool>(&self, epsilon: f32, mut put: impl FnMut(usize, f64)) {
        let logs = self.logs::<FMA>(f64::from(epsilon));
        for (ray, masses) in self.rays.iter().enumerate() {
            let terms = self.p[masses.range.clone()].iter().zip(&logs[masses.range.clone()]);
            put(ray, -terms.map(|(p, log)| p * log).sum::<f64>());
        }
    }

    /// Adds `scale(ray)` · ∂H/∂τ to `out`.
    #[inline(always)]
    pub(crate) fn add_entropy_gradients<const FMA: bool>(
        &self,
        epsilon: f32,
        scale: impl Fn(usize) -> f64,
        out: &mut [f32],
    ) {
        let epsilon = f64::from(epsilon);
        // ∂H/∂p + 1 = −ln(p + ε) − p/(p + ε) + 1. The constant cancels below.
        let dp = |p: f64, log: f64| if epsilon > 0.0 { epsilon / (p + epsilon) - log } else { -log };
        let mut gradients = self.logs::<FMA>(epsilon);
        for (log, &p) in gradients.iter_mut().zip(&self.p) {
            *log = dp(p, *log);
        }
        for (ray, masses) in self.rays.iter().enumerate().filter(|(_, masses)| masses.hits()) {
            let scale = scale(ray);
            let add = |i: usize, g| out[i] += (scale * g) as f32;
            masses.through_normalisation(&self.p, &self.opacity.transmittance, |i| gradients[i], add);
        }
    }

    /// Returns whether `ray` hits something in both distributions.
    fn both_hit(&self, other: &Self, ray: usize) -> bool {
        self.rays[ray].hits() && other.rays[ray].hits()
    }

    /// Computes KL(p ‖ q) = Σ p ln((p + ε)/(q + ε)) of each pair of rays in nats; 0 if either hits nothing.
    ///
    /// Σ (p − q) = 0 is subtracted term by term, which leaves a sum of Bregman divergences: each is ≥ 0, and of second
    /// order where p ≈ q, so nothing cancels. With a = p + ε, b = q + ε: Σ [a ln(a/b) − (a − b)] − ε Σ ln(a/b).
    #[inline(always)]
    pub(crate) fn divergences<const FMA: bool>(&self, other: &Self, epsilon: f32, out: &mut [f32]) {
        let epsilon = f64::from(epsilon);
        let logs = log_ratio::<FMA>(&self.p, &other.p, epsilon);
        for (ray, (masses, out)) in self.rays.iter().zip(out).enumerate() {
            if self.both_hit(other, ray) {
                let term = |i: usize| ((self.p[i] + epsilon) * logs[i] - (self.p[i] - other.p[i])) - epsilon * logs[i];
                *out = masses.range.clone().map(term).sum::<f64>() as f32;
            }
        }
    }

    /// Writes `grad` · ∂KL(p ‖ q)/∂τ and `grad` · ∂KL(p ‖ q)/∂τ̃ into the gradients that are `Some`.
    #[inline(always)]
    pub(crate) fn divergence_gradients<const FMA: bool>(
        &self,
        other: &Self,
        epsilon: f32,
        grad: &[f32],
        [mut dtau, mut dnear]: [Option<&mut [f32]>; 2],
    ) {
        let epsilon = f64::from(epsilon);
        // ∂KL/∂p − 1 = ln((p + ε)/(q + ε)) − ε/(p + ε) and ∂KL/∂q + 1 = 1 − p/(q + ε): both keep their digits where p ≈
        // q. The constants cancel by normalisation.
        let mut dp = log_ratio::<FMA>(&self.p, &other.p, epsilon);
        let mut dq = vec![0.0; dp.len()];
        for (((dp, dq), &p), &q) in dp.iter_mut().zip(&mut dq).zip(&self.p).zip(&other.p) {
            *dp -= epsilon / (p + epsilon);
            *dq = (epsilon - (p - q)) / (q + epsilon);
        }
        for (ray, &grad) in grad.iter().enumerate().filter(|(ray, _)| self.both_hit(other, *ray)) {
            let (grad, masses, near) = (f64::from(grad), &self.rays[ray], &other.rays[ray]);
            if let Some(dtau) = &mut dtau {
                let put = |i: usize, g| dtau[i] = (grad * g) as f32;
                masses.through_normalisation(&self.p, &self.opacity.transmittance, |i| dp[i], put);
            }
            if let Some(dnear) = &mut dnear {
                let put = |i: usize, g| dnear[i] = (grad * g) as f32;
                near.through_normalisation(&other.p, &other.opacity.transmittance, |i| dq[i], put);
            }
        }
    }
}
