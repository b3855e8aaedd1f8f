//! Rays' distributions p = α/Σα on the host, in `f64` and without cancellation: what entropy and information gain are
//! made of.
//!
//! Both are differences of nearly equal numbers where a ray has one surface or a neighbour that looks the same, which is
//! what training drives them to. In `f32` nothing would be left of them there.

use std::ops::Range;

use crate::composite::MIN_ALPHA_SUM;
use crate::groups::Group;
use crate::numeric::{Opacity, ln, log_ratio};

/// p = α/Σα of the rays of a group, packed.
pub(crate) struct Distributions<'a> {
    opacity: &'a Opacity,
    /// 0 along a ray that hits nothing.
    p: Vec<f64>,
    rays: Vec<Ray>,
}

struct Ray {
    range: Range<usize>,
    /// Place of the most opaque sample.
    top: usize,
    /// Σα of all others, summed apart: it may be far below the last digit of Σα.
    rest: f64,
    sum: f64,
}

impl Ray {
    #[inline(always)]
    fn new(range: Range<usize>, alpha: &[f64]) -> Self {
        let (mut top, mut most, mut rest) = (range.start, 0.0, 0.0);
        for (i, &alpha) in range.clone().zip(&alpha[range.clone()]) {
            let above = alpha > most;
            rest += if above { most } else { alpha };
            (top, most) = if above { (i, alpha) } else { (top, most) };
        }
        Self { range, top, rest, sum: most + rest }
    }

    fn hits(&self) -> bool {
        self.sum >= f64::from(MIN_ALPHA_SUM)
    }

    /// From gᵢ = ∂L/∂pᵢ to `put(i, ∂L/∂τᵢ)`, with ∂L/∂τᵢ = (gᵢ − Σ pⱼ gⱼ)/S · e^−τᵢ. What all gᵢ have in common drops out; it
    /// is taken off first.
    #[inline(always)]
    fn through_normalisation(
        &self,
        p: &[f64],
        through: &[f64],
        slope: impl Fn(usize) -> f64,
        mut put: impl FnMut(usize, f64),
    ) {
        let common = slope(self.top);
        let mean: f64 = self.range.clone().map(|i| p[i] * (slope(i) - common)).sum();
        let scale = 1.0 / self.sum;
        for i in self.range.clone() {
            put(i, (slope(i) - common - mean) * scale * through[i]);
        }
    }
}

impl<'a> Distributions<'a> {
    #[inline(always)]
    pub(crate) fn new(opacity: &'a Opacity, group: &Group<'_>) -> Self {
        let rays: Vec<Ray> = group.ranges().map(|range| Ray::new(range, &opacity.alpha)).collect();
        let mut p = vec![0.0; opacity.alpha.len()];
        for ray in rays.iter().filter(|ray| ray.hits()) {
            for (p, alpha) in p[ray.range.clone()].iter_mut().zip(&opacity.alpha[ray.range.clone()]) {
                *p = alpha / ray.sum;
            }
        }
        Self { opacity, p, rays }
    }

    /// ln(p + ε) of every sample. Without ε an empty one counts as the smallest normal `f32`, so that it has a finite slope.
    #[inline(always)]
    fn logs<const FMA: bool>(&self, epsilon: f64) -> Vec<f64> {
        let mut logs: Vec<f64> = self.p.iter().map(|p| p + epsilon).collect();
        for ray in self.rays.iter().filter(|_| epsilon == 0.0) {
            let sum = if ray.hits() { ray.sum } else { 1.0 };
            for (p, alpha) in logs[ray.range.clone()].iter_mut().zip(&self.opacity.alpha[ray.range.clone()]) {
                *p = alpha.max(f64::from(f32::MIN_POSITIVE)) / sum;
            }
        }
        ln::<FMA>(&mut logs);
        // The most opaque sample's p may be 1 to all digits, and its logarithm is that of the others.
        for ray in self.rays.iter().filter(|ray| ray.hits() && 2.0 * ray.rest < ray.sum) {
            logs[ray.top] = (epsilon - ray.rest / ray.sum).ln_1p();
        }
        logs
    }

    /// H = −Σ p ln(p + ε) of each ray in nats, handed to `put`; 0 for a ray that hits nothing.
    #[inline(always)]
    pub(crate) fn entropies<const FMA: bool>(&self, epsilon: f32, mut put: impl FnMut(usize, f64)) {
        let logs = self.logs::<FMA>(f64::from(epsilon));
        for (place, ray) in self.rays.iter().enumerate() {
            let terms = self.p[ray.range.clone()].iter().zip(&logs[ray.range.clone()]);
            put(place, -terms.map(|(p, log)| p * log).sum::<f64>());
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
        // −ln(p + ε) − p/(p + ε), and 1: what all slopes have in common drops out.
        let mut slopes = self.logs::<FMA>(epsilon);
        for (slope, &p) in slopes.iter_mut().zip(&self.p) {
            *slope = if epsilon > 0.0 { epsilon / (p + epsilon) - *slope } else { -*slope };
        }
        for (place, ray) in self.rays.iter().enumerate().filter(|(_, ray)| ray.hits()) {
            let scale = scale(place);
            let add = |i: usize, g| out[i] += (scale * g) as f32;
            ray.through_normalisation(&self.p, &self.opacity.through, |i| slopes[i], add);
        }
    }

    /// Whether ray `place` of both hits something.
    fn both_hit(&self, other: &Self, place: usize) -> bool {
        self.rays[place].hits() && other.rays[place].hits()
    }

    /// KL(p ‖ q) = Σ p ln((p + ε)/(q + ε)) of each pair of rays in nats; 0 if either hits nothing.
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

    /// `grad` · ∂KL(p ‖ q)/∂τ into `dtau` and ∂/∂τ̃ into `dnear`.
    #[inline(always)]
    pub(crate) fn divergence_gradients<const FMA: bool>(
        &self,
        other: &Self,
        epsilon: f32,
        grad: &[f32],
        (dtau, dnear): (&mut [f32], &mut [f32]),
    ) {
        let epsilon = f64::from(epsilon);
        // ln((p + ε)/(q + ε)) + p/(p + ε), less 1, and −p/(q + ε), and 1: what all have in common drops out, and the rest keeps
        // its digits where p ≈ q.
        let mut dp = log_ratio::<FMA>(&self.p, &other.p, epsilon);
        let mut dq = vec![0.0; dp.len()];
        for (((dp, dq), &p), &q) in dp.iter_mut().zip(&mut dq).zip(&self.p).zip(&other.p) {
            *dp -= epsilon / (p + epsilon);
            *dq = (epsilon - (p - q)) / (q + epsilon);
        }
        for (place, &grad) in grad.iter().enumerate().filter(|(place, _)| self.both_hit(other, *place)) {
            let (grad, ray, near) = (f64::from(grad), &self.rays[place], &other.rays[place]);
            let put = |i: usize, g| dtau[i] = (grad * g) as f32;
            ray.through_normalisation(&self.p, &self.opacity.through, |i| dp[i], put);
            let put = |i: usize, g| dnear[i] = (grad * g) as f32;
            near.through_normalisation(&other.p, &other.opacity.through, |i| dq[i], put);
        }
    }
}
