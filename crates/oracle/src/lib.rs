//! The operations of `infonerf-ops` in `f64`, written for clarity: the oracle that bounds the error of every body.
//!
//! Gradients are exact derivatives of the functions as defined, computed term by term rather than by the running sums
//! of the fast bodies, so that the two share no shortcut. Where the textbook formula is a difference of nearly equal
//! values, another is used: an oracle with cancellation could not decide which body is wrong. The tests of `infonerf-ops`
//! compare the oracle with values of arbitrary precision.

mod encodings;
pub mod factored;

pub use encodings::{frustum_moments, waves, waves_gradient};
use infonerf_ops::entropy::MIN_ALPHA_SUM;

/// Computes α = 1 − e^−τ.
pub fn alpha(tau: f64) -> f64 {
    -(-tau).exp_m1()
}

/// Computes Tᵢ = exp(−Σ_{j<i} τⱼ) for i from 0 to N, where T_N is the transmittance of the whole ray of N samples.
pub fn transmittance(tau: &[f64]) -> Vec<f64> {
    let mut sum = 0f64;
    let behind = tau.iter().map(|tau| {
        sum += tau;
        (-sum).exp()
    });
    std::iter::once(1.0).chain(behind).collect()
}

/// Computes wᵢ = Tᵢ αᵢ.
pub fn weights(tau: &[f64]) -> Vec<f64> {
    transmittance(tau).iter().zip(tau).map(|(t, &tau)| t * alpha(tau)).collect()
}

/// Computes Σ w = 1 − e^(−Σ τ).
pub fn opacity(tau: &[f64]) -> f64 {
    alpha(tau.iter().sum())
}

/// Returns ∂(Σ uᵢ wᵢ)/∂τ for fixed u.
///
/// The result uᵢ T_{i+1} − Σ_{j>i} uⱼ wⱼ equals Σ_{j>i} (uᵢ − uⱼ) wⱼ + uᵢ T_N, as T_{i+1} = Σ_{j>i} wⱼ + T_N.
pub fn weights_vjp(tau: &[f64], u: &[f64]) -> Vec<f64> {
    let (trans, w) = (transmittance(tau), weights(tau));
    let behind = |i: usize| (i + 1..tau.len()).map(|j| (u[i] - u[j]) * w[j]).sum::<f64>();
    (0..tau.len()).map(|i| behind(i) + u[i] * trans[tau.len()]).collect()
}

/// Returns the weights of the additive march of Neural Volumes: wᵢ = min(Aᵢ + τᵢ, 1) − Aᵢ with Aᵢ = Σ_{j<i} wⱼ.
pub fn additive_weights(tau: &[f64]) -> Vec<f64> {
    let mut opacity = 0f64;
    let mut weight = |tau: &f64| {
        let before = opacity;
        opacity = (before + tau).min(1.0);
        opacity - before
    };
    tau.iter().map(&mut weight).collect()
}

/// Returns ∂(Σ uᵢ wᵢ)/∂τ of the additive march for fixed u. If sample f fills the ray, the derivative is uᵢ − u_f in
/// front of f, and 0 from f on; if none does, it is uᵢ.
pub fn additive_weights_vjp(tau: &[f64], u: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let fills = tau.iter().position(|tau| {
        sum += tau;
        sum >= 1.0
    });
    let dp = |i: usize| match fills {
        Some(last) if i >= last => 0.0,
        Some(last) => u[i] - u[last],
        None => u[i],
    };
    (0..tau.len()).map(dp).collect()
}

/// Computes p = α/Σα; `None` if Σα is below [`MIN_ALPHA_SUM`].
pub fn ray_density(tau: &[f64]) -> Option<Vec<f64>> {
    let sum = alpha_sum(tau);
    (sum >= f64::from(MIN_ALPHA_SUM)).then(|| tau.iter().map(|&tau| alpha(tau) / sum).collect())
}

/// Computes Σ α.
pub fn alpha_sum(tau: &[f64]) -> f64 {
    tau.iter().map(|&tau| alpha(tau)).sum()
}

/// Computes ln(p + ε) of p = α/`sum`. If ε is 0, α counts as at least the smallest normal `f32`.
fn ln_density(p: &[f64], sum: f64, epsilon: f64) -> Vec<f64> {
    let least = f64::from(f32::MIN_POSITIVE) / sum;
    // A p above ½ is 1 − (sum of all others), which keeps all digits.
    let others = |i: usize| (0..p.len()).filter(|&j| j != i).map(|j| p[j]).sum::<f64>();
    let ln = |(i, &p): (usize, &f64)| match p {
        p if p > 0.5 => (epsilon - others(i)).ln_1p(),
        p if epsilon > 0.0 => (p + epsilon).ln(),
        p => p.max(least).ln(),
    };
    p.iter().enumerate().map(ln).collect()
}

/// Computes H = −Σ p log₂(p + ε) in bits; 0 for a ray that hits nothing.
pub fn entropy(tau: &[f64], epsilon: f64) -> f64 {
    let Some(p) = ray_density(tau) else { return 0.0 };
    let ln = ln_density(&p, alpha_sum(tau), epsilon);
    -p.iter().zip(ln).map(|(p, ln)| p * ln).sum::<f64>() * std::f64::consts::LOG2_E
}

/// Computes ∂H/∂τ.
pub fn entropy_gradient(tau: &[f64], epsilon: f64) -> Vec<f64> {
    let Some(p) = ray_density(tau) else { return vec![0.0; tau.len()] };
    // ∂H/∂p + 1 = −ln(p + ε) − p/(p + ε) + 1. The constant cancels below.
    let dp = |(p, ln): (&f64, f64)| if epsilon > 0.0 { epsilon / (p + epsilon) - ln } else { -ln };
    let gradients: Vec<f64> = p.iter().zip(ln_density(&p, alpha_sum(tau), epsilon)).map(dp).collect();
    through_normalisation(tau, &p, &gradients).into_iter().map(|g| g * std::f64::consts::LOG2_E).collect()
}

/// Computes ln((p + ε)/(q + ε)) of each pair of samples.
fn ln_ratios(p: &[f64], q: &[f64], epsilon: f64) -> Vec<f64> {
    let ln = |(p, q): (&f64, &f64)| {
        let r = (p - q) / (q + epsilon);
        // If ε is 0, the logarithm of an empty sample of P stays finite, so that p ln p is 0.
        let a = (p + epsilon).max(f64::MIN_POSITIVE);
        if r.abs() < 0.5 { r.ln_1p() } else { (a / (q + epsilon)).ln() }
    };
    p.iter().zip(q).map(ln).collect()
}

/// Computes KL(P ‖ Q) in nats with ε in both logarithms; 0 where either ray hits nothing.
///
/// Each term of Σ p ln((p + ε)/(q + ε)) is reduced by p − q, whose sum is 0. Terms are then of second order where p ≈ q.
pub fn divergence(tau: &[f64], near: &[f64], epsilon: f64) -> f64 {
    let (Some(p), Some(q)) = (ray_density(tau), ray_density(near)) else { return 0.0 };
    let samples = p.iter().zip(&q).zip(ln_ratios(&p, &q, epsilon));
    samples.map(|((p, q), ln)| (p + epsilon) * ln - (p - q) - epsilon * ln).sum()
}

/// Computes (∂KL/∂τ, ∂KL/∂τ̃).
pub fn divergence_gradient(tau: &[f64], near: &[f64], epsilon: f64) -> (Vec<f64>, Vec<f64>) {
    let (Some(p), Some(q)) = (ray_density(tau), ray_density(near)) else {
        return (vec![0.0; tau.len()], vec![0.0; near.len()]);
    };
    // ∂KL/∂p − 1 = ln((p + ε)/(q + ε)) − ε/(p + ε) and ∂KL/∂q + 1 = 1 − p/(q + ε). The constants cancel by normalisation.
    let lost = |p: f64| if epsilon > 0.0 { epsilon / (p + epsilon) } else { 0.0 };
    let dp: Vec<f64> = ln_ratios(&p, &q, epsilon).iter().zip(&p).map(|(ln, &p)| ln - lost(p)).collect();
    let dq: Vec<f64> = p.iter().zip(&q).map(|(p, q)| (epsilon - (p - q)) / (q + epsilon)).collect();
    (through_normalisation(tau, &p, &dp), through_normalisation(near, &q, &dq))
}

/// Computes ∂L/∂τ from gᵢ = ∂L/∂pᵢ and p = α/Σα: ∂L/∂αᵢ = (gᵢ − Σ pⱼ gⱼ)/Σα and ∂α/∂τ = e^−τ. As Σ p = 1, a constant in
/// all gᵢ cancels; it is subtracted first.
fn through_normalisation(tau: &[f64], p: &[f64], gradients: &[f64]) -> Vec<f64> {
    let sum = alpha_sum(tau);
    let most = (0..p.len()).max_by(|&i, &j| p[i].total_cmp(&p[j])).map_or(0.0, |i| gradients[i]);
    let mean: f64 = p.iter().zip(gradients).map(|(p, g)| p * (g - most)).sum();
    tau.iter().zip(gradients).map(|(&tau, g)| (g - most - mean) / sum * (-tau).exp()).collect()
}
