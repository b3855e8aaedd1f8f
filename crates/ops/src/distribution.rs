//! Distributions along rays on the host, in `f64` and without cancellation, for ray entropy and the divergence of
//! neighbouring rays.
//!
//! Training drives rays towards one surface, and neighbouring rays towards equal distributions. Entropy and divergence
//! are then differences of nearly equal numbers, which would lose all digits in `f32`.

use std::ops::Range;

use crate::composite::MIN_ALPHA_SUM;
use crate::entropy::RayDistribution;
use crate::numeric::{SampleOpacity, ln, log_ratio};
use crate::ray_kernel::Group;

/// Distributions of the rays of a group: probabilities of their samples, packed, and of the background.
pub(crate) struct Distributions<'a> {
    opacity: &'a SampleOpacity,
    kind: RayDistribution,
    /// Probability of each sample; 0 along a ray that hits nothing.
    p: Vec<f64>,
    rays: Vec<RayMasses>,
}

/// Distribution along one ray. The *mass* of a sample is its probability before normalisation.
struct RayMasses {
    range: Range<usize>,
    /// Index of the sample with the largest mass; `None` if the background has it.
    top: Option<usize>,
    /// Sum of all masses but the largest, kept separately: it may be below the last digit of `sum`.
    rest: f64,
    sum: f64,
    background: f64,
}

impl RayMasses {
    /// Sums the masses of the samples in `range` and the mass `background`.
    #[inline(always)]
    fn new(range: Range<usize>, mass: &[f64], background: f64) -> Self {
        let (mut top, mut most, mut rest) = (None, background, 0.0);
        for (i, &mass) in range.clone().zip(&mass[range.clone()]) {
            let above = mass > most;
            rest += if above { most } else { mass };
            (top, most) = if above { (Some(i), mass) } else { (top, most) };
        }
        let sum = most + rest;
        Self { range, top, rest, sum, background: if background > 0.0 { background / sum } else { 0.0 } }
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
        background: f64,
        mut put: impl FnMut(usize, f64),
    ) {
        let common = self.top.map_or(background, &dp);
        let samples: f64 = self.range.clone().map(|i| p[i] * (dp(i) - common)).sum();
        let mean = samples + self.background * (background - common);
        let scale = 1.0 / self.sum;
        for i in self.range.clone() {
            put(i, (dp(i) - common - mean) * scale * transmittance[i]);
        }
    }

    /// Calls `put(i, ∂L/∂τᵢ)` with ∂L/∂τᵢ = Tᵢ₊₁ (gᵢ − mean of g behind sample i), given gᵢ = ∂L/∂wᵢ.
    #[inline(always)]
    fn through_weights(
        &self,
        opacity: &SampleOpacity,
        dp: impl Fn(usize) -> f64,
        background: f64,
        mut put: impl FnMut(usize, f64),
    ) {
        let mut trans: Vec<f64> = opacity.transmittance[self.range.clone()]
            .iter()
            .scan(1.0, |trans, transmittance| {
                *trans *= transmittance;
                Some(*trans)
            })
            .collect();
        let mut behind = background;
        for i in self.range.clone().rev() {
            put(i, trans.pop().unwrap_or(1.0) * (dp(i) - behind));
            behind = opacity.alpha[i] * dp(i) + opacity.transmittance[i] * behind;
        }
    }
}

impl<'a> Distributions<'a> {
    #[inline(always)]
    pub(crate) fn new(opacity: &'a SampleOpacity, group: &Group<'_>, kind: RayDistribution) -> Self {
        let mut p = opacity.alpha.clone();
        let rays: Vec<RayMasses> = group
            .ranges()
            .map(|range| {
                let background = match kind {
                    RayDistribution::Alpha => 0.0,
                    RayDistribution::AlphaBackground => 1.0,
                    RayDistribution::Termination => {
                        let mut trans = 1.0;
                        for i in range.clone() {
                            p[i] *= trans;
                            trans *= opacity.transmittance[i];
                        }
                        trans
                    }
                };
                let ray = RayMasses::new(range, &p, background);
                let scale = if ray.hits() { 1.0 / ray.sum } else { 0.0 };
                p[ray.range.clone()].iter_mut().for_each(|p| *p *= scale);
                ray
            })
            .collect();
        Self { opacity, kind, p, rays }
    }

    /// Computes ln(p + ε) of each sample, and of each ray's background. If ε is 0, a probability counts as at least the
    /// smallest normal `f32` over the ray's sum, so that its gradient is finite.
    #[inline(always)]
    fn logs<const FMA: bool>(&self, epsilon: f64) -> (Vec<f64>, Vec<f64>) {
        let mut logs: Vec<f64> = self.p.iter().map(|p| p + epsilon).collect();
        if epsilon == 0.0 {
            for ray in &self.rays {
                let least = f64::from(f32::MIN_POSITIVE) / if ray.hits() { ray.sum } else { 1.0 };
                logs[ray.range.clone()].iter_mut().for_each(|p| *p = p.max(least));
            }
        }
        for log in &mut logs {
            *log = ln::<FMA>(*log);
        }
        let certain = |ray: &RayMasses| (epsilon - ray.rest / ray.sum).ln_1p();
        let mut background = Vec::with_capacity(self.rays.len());
        for ray in &self.rays {
            let is_certain = ray.is_certain();
            if let Some(top) = ray.top.filter(|_| is_certain) {
                logs[top] = certain(ray);
            }
            background.push(match ray.top {
                _ if ray.background == 0.0 => 0.0,
                None if is_certain => certain(ray),
                _ => (ray.background + epsilon).max(f64::from(f32::MIN_POSITIVE)).ln(),
            });
        }
        (logs, background)
    }

    /// Calls `put` with each ray's place and H = −Σ p ln(p + ε) in nats; 0 for a ray that hits nothing.
    #[inline(always)]
    pub(crate) fn entropies<const FMA: bool>(&self, epsilon: f32, mut put: impl FnMut(usize, f64)) {
        let (logs, background) = self.logs::<FMA>(f64::from(epsilon));
        for (place, (ray, last)) in self.rays.iter().zip(background).enumerate() {
            let terms = self.p[ray.range.clone()].iter().zip(&logs[ray.range.clone()]);
            put(place, -terms.map(|(p, log)| p * log).sum::<f64>() - ray.background * last);
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
        let (mut gradients, background) = self.logs::<FMA>(epsilon);
        for (log, &p) in gradients.iter_mut().zip(&self.p) {
            *log = dp(p, *log);
        }
        for (place, ray) in self.rays.iter().enumerate().filter(|(_, ray)| ray.hits()) {
            let scale = scale(place);
            let add = |i: usize, g| out[i] += (scale * g) as f32;
            let last = dp(ray.background, background[place]);
            if self.kind == RayDistribution::Termination {
                ray.through_weights(self.opacity, |i| gradients[i], last, add);
            } else {
                ray.through_normalisation(&self.p, &self.opacity.transmittance, |i| gradients[i], last, add);
            }
        }
    }

    /// Returns whether ray `place` hits something in both distributions.
    fn both_hit(&self, other: &Self, place: usize) -> bool {
        self.rays[place].hits() && other.rays[place].hits()
    }

    /// Computes KL(p ‖ q) = Σ p ln((p + ε)/(q + ε)) of each pair of rays in nats; 0 if either hits nothing.
    ///
    /// Σ (p − q) = 0 is subtracted term by term, which leaves a sum of Bregman divergences: each is ≥ 0, and of second
    /// order where p ≈ q, so nothing cancels. With a = p + ε, b = q + ε: Σ [a ln(a/b) − (a − b)] − ε Σ ln(a/b).
    #[inline(always)]
    pub(crate) fn divergences<const FMA: bool>(&self, other: &Self, epsilon: f32, out: &mut [f32]) {
        let epsilon = f64::from(epsilon);
        let logs = log_ratio::<FMA>(&self.p, &other.p, epsilon);
        for (place, (ray, out)) in self.rays.iter().zip(out).enumerate() {
            if self.both_hit(other, place) {
                let term = |i: usize| ((self.p[i] + epsilon) * logs[i] - (self.p[i] - other.p[i])) - epsilon * logs[i];
                *out = ray.range.clone().map(term).sum::<f64>() as f32;
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
        for (place, &grad) in grad.iter().enumerate().filter(|(place, _)| self.both_hit(other, *place)) {
            let (grad, ray, near) = (f64::from(grad), &self.rays[place], &other.rays[place]);
            if let Some(dtau) = &mut dtau {
                let put = |i: usize, g| dtau[i] = (grad * g) as f32;
                ray.through_normalisation(&self.p, &self.opacity.transmittance, |i| dp[i], 0.0, put);
            }
            if let Some(dnear) = &mut dnear {
                let put = |i: usize, g| dnear[i] = (grad * g) as f32;
                near.through_normalisation(&other.p, &other.opacity.transmittance, |i| dq[i], 0.0, put);
            }
        }
    }
}
