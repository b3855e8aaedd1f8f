//! A ray's distribution p = α/Σα on the host, in `f64` and without cancellation: what entropy and information gain are
//! made of.
//!
//! Both are differences of nearly equal numbers where a ray has one surface or a neighbour that looks the same, which is
//! what training drives them to. In `f32` nothing would be left of them there.

use crate::composite::MIN_ALPHA_SUM;

/// p = α/Σα of one ray that hits something.
pub(crate) struct Distribution {
    alpha: Vec<f64>,
    /// Place of the most opaque sample.
    top: usize,
    /// Σα of all others, summed apart: it may be far below the last digit of Σα.
    rest: f64,
    sum: f64,
    epsilon: f64,
}

impl Distribution {
    /// None for a ray that hits nothing.
    pub(crate) fn new(tau: &[f32], epsilon: f32) -> Option<Self> {
        let alpha: Vec<f64> = tau.iter().map(|&tau| -(-f64::from(tau)).exp_m1()).collect();
        let (mut top, mut rest) = (0, 0.0);
        for (i, &a) in alpha.iter().enumerate().skip(1) {
            if a > alpha[top] {
                rest += alpha[top];
                top = i;
            } else {
                rest += a;
            }
        }
        let sum = alpha.get(top)? + rest;
        (sum >= f64::from(MIN_ALPHA_SUM)).then_some(Self { alpha, top, rest, sum, epsilon: f64::from(epsilon) })
    }

    fn p(&self, i: usize) -> f64 {
        self.alpha[i] / self.sum
    }

    /// ln(pᵢ + ε). Without ε an empty sample counts as the smallest normal `f32`, so that it has a finite slope.
    fn ln(&self, i: usize) -> f64 {
        if i == self.top && self.rest < self.alpha[i] {
            (self.epsilon - self.rest / self.sum).ln_1p()
        } else if self.epsilon > 0.0 {
            (self.p(i) + self.epsilon).ln()
        } else {
            (self.alpha[i].max(f64::from(f32::MIN_POSITIVE)) / self.sum).ln()
        }
    }

    /// p/(p + ε).
    fn share(&self, i: usize) -> f64 {
        if self.epsilon > 0.0 { self.p(i) / (self.p(i) + self.epsilon) } else { 1.0 }
    }

    /// H = −Σ p ln(p + ε), nats.
    pub(crate) fn entropy(&self) -> f64 {
        -(0..self.alpha.len()).map(|i| self.p(i) * self.ln(i)).sum::<f64>()
    }

    /// Adds `scale` · ∂H/∂τ to `out`.
    pub(crate) fn entropy_gradient(&self, tau: &[f32], scale: f64, out: &mut [f32]) {
        self.through_normalisation(tau, |i| -self.ln(i) - self.share(i), |i, g| out[i] += (scale * g) as f32);
    }

    /// ln((pᵢ + ε)/(qᵢ + ε)), to all digits also where p and q are nearly equal.
    fn ln_ratio(&self, other: &Self, i: usize) -> f64 {
        let (a, b) = (self.p(i) + self.epsilon, other.p(i) + self.epsilon);
        let r = (self.p(i) - other.p(i)) / b;
        if r.abs() < 0.5 { r.ln_1p() } else { (a / b).ln() }
    }

    /// KL(p ‖ q) = Σ p ln((p + ε)/(q + ε)), nats.
    ///
    /// Σ (p − q) = 0 is subtracted term by term, which leaves a sum of Bregman divergences: each is ≥ 0, and of second
    /// order where p ≈ q, so nothing cancels. With a = p + ε, b = q + ε: Σ [a ln(a/b) − (a − b)] − ε Σ ln(a/b).
    pub(crate) fn divergence(&self, other: &Self) -> f64 {
        let term = |i: usize| {
            let ln = self.ln_ratio(other, i);
            let bregman = (self.p(i) + self.epsilon) * ln - (self.p(i) - other.p(i));
            bregman - self.epsilon * ln
        };
        (0..self.alpha.len()).map(term).sum()
    }

    /// `scale` · ∂KL(p ‖ q)/∂τ into `dtau` and ∂/∂τ̃ into `dnear`.
    pub(crate) fn divergence_gradient(
        &self,
        other: &Self,
        (tau, near): (&[f32], &[f32]),
        scale: f64,
        (dtau, dnear): (&mut [f32], &mut [f32]),
    ) {
        let dp = |i: usize| self.ln_ratio(other, i) + self.share(i);
        self.through_normalisation(tau, dp, |i, g| dtau[i] = (scale * g) as f32);
        let dq = |i: usize| -self.p(i) / (other.p(i) + self.epsilon);
        other.through_normalisation(near, dq, |i, g| dnear[i] = (scale * g) as f32);
    }

    /// From gᵢ = ∂L/∂pᵢ to ∂L/∂τᵢ = (gᵢ − Σ pⱼ gⱼ)/S · e^−τᵢ. What all gᵢ have in common drops out; it is taken off first.
    fn through_normalisation(&self, tau: &[f32], slope: impl Fn(usize) -> f64, mut put: impl FnMut(usize, f64)) {
        let common = slope(self.top);
        let slopes: Vec<f64> = (0..tau.len()).map(|i| slope(i) - common).collect();
        let mean: f64 = slopes.iter().enumerate().map(|(i, g)| self.p(i) * g).sum();
        for (i, (g, &tau)) in slopes.iter().zip(tau).enumerate() {
            put(i, (g - mean) / self.sum * f64::from(-tau).exp());
        }
    }
}
