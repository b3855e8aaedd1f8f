//! The whole chain in `f64`, written for clarity: the oracle that bounds the error of every body.
//!
//! Gradients are exact derivatives of the functions as defined, computed term by term rather than by the running sums
//! of the fast bodies, so that the two share no shortcut. Where the textbook formula is a difference of nearly equal
//! numbers, one is used that is not: an oracle that cancels could not tell who is wrong. `tests/agreement.rs` holds all
//! of it against closed forms and against values of arbitrary precision.

use crate::RayDistribution;
use crate::composite::MIN_ALPHA_SUM;

/// α = 1 − e^−τ.
pub fn alpha(tau: f64) -> f64 {
    -(-tau).exp_m1()
}

/// Tᵢ = exp(−Σ_{j<i} τⱼ), one more than samples: the last is what leaves the ray.
pub fn transmittance(tau: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    std::iter::once(1.0)
        .chain(tau.iter().map(|tau| {
            sum += tau;
            (-sum).exp()
        }))
        .collect()
}

/// wᵢ = Tᵢ αᵢ.
pub fn weights(tau: &[f64]) -> Vec<f64> {
    transmittance(tau).iter().zip(tau).map(|(t, &tau)| t * alpha(tau)).collect()
}

/// Σ w = 1 − e^(−Σ τ).
pub fn opacity(tau: &[f64]) -> f64 {
    alpha(tau.iter().sum())
}

/// ∂(Σ uᵢ wᵢ)/∂τ for fixed u.
///
/// uᵢ T_{i+1} − Σ_{j>i} uⱼ wⱼ with T_{i+1} = Σ_{j>i} wⱼ + T_N put in: Σ_{j>i} (uᵢ − uⱼ) wⱼ + uᵢ T_N.
pub fn weights_vjp(tau: &[f64], u: &[f64]) -> Vec<f64> {
    let (trans, w) = (transmittance(tau), weights(tau));
    let behind = |i: usize| (i + 1..tau.len()).map(|j| (u[i] - u[j]) * w[j]).sum::<f64>();
    (0..tau.len()).map(|i| behind(i) + u[i] * trans[tau.len()]).collect()
}

/// Weights of the additive march of Neural Volumes: wᵢ = min(Aᵢ + τᵢ, 1) − Aᵢ with Aᵢ = Σ_{j<i} wⱼ.
pub fn additive_weights(tau: &[f64]) -> Vec<f64> {
    let mut opacity = 0f64;
    let mut weight = |tau: &f64| {
        let before = opacity;
        opacity = (before + tau).min(1.0);
        opacity - before
    };
    tau.iter().map(&mut weight).collect()
}

/// ∂(Σ uᵢ wᵢ)/∂τ of the additive march for fixed u: a sample takes from the one that fills the ray what it gets itself.
pub fn additive_weights_vjp(tau: &[f64], u: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let fills = tau.iter().position(|tau| {
        sum += tau;
        sum >= 1.0
    });
    let slope = |i: usize| match fills {
        Some(last) if i >= last => 0.0,
        Some(last) => u[i] - u[last],
        None => u[i],
    };
    (0..tau.len()).map(slope).collect()
}

/// p = α/Σα, or `None` where Σα is below [`MIN_ALPHA_SUM`].
pub fn ray_density(tau: &[f64]) -> Option<Vec<f64>> {
    let sum = alpha_sum(tau);
    (sum >= f64::from(MIN_ALPHA_SUM)).then(|| tau.iter().map(|&tau| alpha(tau) / sum).collect())
}

/// Σ α.
pub fn alpha_sum(tau: &[f64]) -> f64 {
    tau.iter().map(|&tau| alpha(tau)).sum()
}

/// Masses of the samples, and of the background if the distribution has one, before normalisation; with their sum, exact
/// also where it is 1 by definition.
fn masses(tau: &[f64], distribution: RayDistribution) -> (Vec<f64>, f64) {
    let alphas = || tau.iter().map(|&tau| alpha(tau));
    match distribution {
        RayDistribution::Alpha => (alphas().collect(), alpha_sum(tau)),
        RayDistribution::AlphaBackground => (alphas().chain([1.0]).collect(), alpha_sum(tau) + 1.0),
        RayDistribution::Termination => {
            let background = transmittance(tau)[tau.len()];
            (weights(tau).into_iter().chain([background]).collect(), 1.0)
        }
    }
}

/// ln(p + ε); without ε a mass counts as at least the smallest normal `f32`.
fn ln_density(masses: &[f64], sum: f64, epsilon: f64) -> Vec<f64> {
    let floor = f64::from(f32::MIN_POSITIVE);
    // A sample that holds more than half of the ray: p = 1 − (all others)/sum.
    let others = |i: usize| (0..masses.len()).filter(|&j| j != i).map(|j| masses[j]).sum::<f64>();
    let ln = |(i, &mass): (usize, &f64)| match mass {
        mass if mass > 0.5 * sum => (epsilon - others(i) / sum).ln_1p(),
        mass if epsilon > 0.0 => (mass / sum + epsilon).ln(),
        mass => (mass.max(floor) / sum).ln(),
    };
    masses.iter().enumerate().map(ln).collect()
}

/// H = −Σ p log₂(p + ε) in bits; 0 for a ray that hits nothing.
pub fn entropy(tau: &[f64], distribution: RayDistribution, epsilon: f64) -> f64 {
    let (masses, sum) = masses(tau, distribution);
    if sum < f64::from(MIN_ALPHA_SUM) {
        return 0.0;
    }
    let ln = ln_density(&masses, sum, epsilon);
    -masses.iter().zip(ln).map(|(mass, ln)| mass / sum * ln).sum::<f64>() * std::f64::consts::LOG2_E
}

/// ∂H/∂τ.
pub fn entropy_gradient(tau: &[f64], distribution: RayDistribution, epsilon: f64) -> Vec<f64> {
    let (masses, sum) = masses(tau, distribution);
    if sum < f64::from(MIN_ALPHA_SUM) {
        return vec![0.0; tau.len()];
    }
    // −ln(p + ε) − p/(p + ε), without the −1 that all have in common.
    let slope = |(mass, ln): (&f64, f64)| if epsilon > 0.0 { epsilon / (mass / sum + epsilon) - ln } else { -ln };
    let slopes: Vec<f64> = masses.iter().zip(ln_density(&masses, sum, epsilon)).map(slope).collect();
    let gradient = match distribution {
        RayDistribution::Termination => {
            // Relative to the background, whose probability is what the weights leave: ∂Σw/∂τ = −∂(1 − Σw)/∂τ.
            let background = slopes[tau.len()];
            weights_vjp(tau, &slopes[..tau.len()].iter().map(|slope| slope - background).collect::<Vec<_>>())
        }
        _ => through_normalisation(tau, &masses, sum, &slopes),
    };
    gradient.into_iter().map(|g| g * std::f64::consts::LOG2_E).collect()
}

/// ln((p + ε)/(q + ε)) of each pair of samples.
fn ln_ratios(p: &[f64], q: &[f64], epsilon: f64) -> Vec<f64> {
    let ln = |(p, q): (&f64, &f64)| {
        let r = (p - q) / (q + epsilon);
        // Without ε an empty sample of P has p ln p = 0.
        let a = (p + epsilon).max(f64::MIN_POSITIVE);
        if r.abs() < 0.5 { r.ln_1p() } else { (a / (q + epsilon)).ln() }
    };
    p.iter().zip(q).map(ln).collect()
}

/// KL(P ‖ Q) in nats with ε in both logarithms; 0 where either ray hits nothing.
///
/// Σ p ln((p + ε)/(q + ε)), less Σ (p − q) = 0 term by term: what remains is of second order where p ≈ q.
pub fn divergence(tau: &[f64], near: &[f64], epsilon: f64) -> f64 {
    let (Some(p), Some(q)) = (ray_density(tau), ray_density(near)) else { return 0.0 };
    p.iter()
        .zip(&q)
        .zip(ln_ratios(&p, &q, epsilon))
        .map(|((p, q), ln)| (p + epsilon) * ln - (p - q) - epsilon * ln)
        .sum()
}

/// (∂KL/∂τ, ∂KL/∂τ̃).
pub fn divergence_gradient(tau: &[f64], near: &[f64], epsilon: f64) -> (Vec<f64>, Vec<f64>) {
    let (Some(p), Some(q)) = (ray_density(tau), ray_density(near)) else {
        return (vec![0.0; tau.len()], vec![0.0; near.len()]);
    };
    // ln((p + ε)/(q + ε)) + p/(p + ε) and −p/(q + ε), without the 1 and the −1 that all have in common.
    let lost = |p: f64| if epsilon > 0.0 { epsilon / (p + epsilon) } else { 0.0 };
    let dp: Vec<f64> = ln_ratios(&p, &q, epsilon).iter().zip(&p).map(|(ln, &p)| ln - lost(p)).collect();
    let dq: Vec<f64> = p.iter().zip(&q).map(|(p, q)| (epsilon - (p - q)) / (q + epsilon)).collect();
    (through_normalisation(tau, &p, alpha_sum(tau), &dp), through_normalisation(near, &q, alpha_sum(near), &dq))
}

/// Σᵢⱼ wᵢ wⱼ |mᵢ − mⱼ| + ⅓ Σ wᵢ² δᵢ.
pub fn distortion(tau: &[f64], middle: &[f64], length: &[f64]) -> f64 {
    let w = weights(tau);
    let between = |i: usize| (0..w.len()).map(|j| w[j] * (middle[i] - middle[j]).abs()).sum::<f64>();
    (0..w.len()).map(|i| w[i] * (between(i) + w[i] * length[i] / 3.0)).sum()
}

/// ∂(distortion)/∂τ, ∂/∂m and ∂/∂δ.
pub fn distortion_gradient(tau: &[f64], middle: &[f64], length: &[f64]) -> [Vec<f64>; 3] {
    let w = weights(tau);
    let sum = |i: usize, f: fn(f64) -> f64| (0..w.len()).map(|j| w[j] * f(middle[i] - middle[j])).sum::<f64>();
    let slopes: Vec<f64> = (0..w.len()).map(|i| 2.0 * sum(i, f64::abs) + 2.0 / 3.0 * w[i] * length[i]).collect();
    let sign = |x: f64| if x == 0.0 { 0.0 } else { x.signum() };
    let dmiddle = (0..w.len()).map(|i| 2.0 * w[i] * sum(i, sign)).collect();
    [weights_vjp(tau, &slopes), dmiddle, w.iter().map(|w| w * w / 3.0).collect()]
}

/// From ∂L/∂p to ∂L/∂τ, where p is `masses` over their sum S: ∂L/∂αᵢ = (gᵢ − Σ pⱼ gⱼ)/S and ∂α/∂τ = e^−τ. As Σ p = 1, a
/// constant in g drops out.
fn through_normalisation(tau: &[f64], masses: &[f64], sum: f64, slopes: &[f64]) -> Vec<f64> {
    let total: f64 = masses.iter().sum();
    let most = (0..masses.len()).max_by(|&i, &j| masses[i].total_cmp(&masses[j])).map_or(0.0, |i| slopes[i]);
    let mean: f64 = masses.iter().zip(slopes).map(|(mass, g)| mass / total * (g - most)).sum();
    tau.iter().zip(slopes).map(|(&tau, g)| (g - most - mean) / sum * (-tau).exp()).collect()
}

/// Sine and cosine of 2ˡx for each frequency l, times its weight and exp(−½ 4ˡσ²): one coordinate's part of the encodings.
pub fn waves(x: f64, variance: f64, window: &[f64]) -> Vec<[f64; 2]> {
    let wave = |(l, weight): (usize, &f64)| {
        let scale = 2f64.powi(l as i32);
        let fading = weight * (-0.5 * scale * scale * variance).exp();
        [fading * (scale * x).sin(), fading * (scale * x).cos()]
    };
    window.iter().enumerate().map(wave).collect()
}

/// The gradients of Σ u · [`waves`] with respect to x and σ².
pub fn waves_gradient(x: f64, variance: f64, window: &[f64], u: &[[f64; 2]]) -> [f64; 2] {
    let terms = waves(x, variance, window).into_iter().zip(u).enumerate().map(|(l, ([sine, cosine], u))| {
        let scale = 2f64.powi(l as i32);
        [scale * (u[0] * cosine - u[1] * sine), -0.5 * scale * scale * (u[0] * sine + u[1] * cosine)]
    });
    terms.fold([0.0; 2], |sum, term| [sum[0] + term[0], sum[1] + term[1]])
}

/// Mean distance, variance along and variance across the ray of the cone's piece from `t0` to `t1`, as quotients of
/// integrals over its volume (mip-NeRF, Eq. 29–37): the cone's cross-section grows as t².
pub fn frustum_moments(t0: f64, t1: f64, radius: f64) -> [f64; 3] {
    // ∫ tⁿ dt by Gauss–Legendre with 4 nodes, exact to degree 7: no difference of large powers.
    let nodes =
        [(0.339_981_043_584_856_3, 0.652_145_154_862_546_1), (0.861_136_311_594_052_6, 0.347_854_845_137_453_85)];
    let (middle, half) = (0.5 * (t0 + t1), 0.5 * (t1 - t0));
    let integral = |f: &dyn Fn(f64) -> f64| {
        nodes.iter().map(|(x, w)| w * (f(middle + half * x) + f(middle - half * x))).sum::<f64>() * half
    };
    let volume = integral(&|t| t * t);
    let mean = integral(&|t| t.powi(3)) / volume;
    let along = integral(&|t| t * t * (t - mean).powi(2)) / volume;
    // Over a disc of radius r the mean of x² is r²/4.
    let across = integral(&|t| t * t * (radius * t).powi(2) / 4.0) / volume;
    [mean, along, across]
}

/// E[f(x)] for x ~ N(mean, deviation²): the trapezoidal rule over ±12 deviations, which converges geometrically.
pub fn gaussian_mean(mean: f64, deviation: f64, f: impl Fn(f64) -> f64) -> f64 {
    const STEPS: i32 = 4000;
    let points = (-STEPS..=STEPS).map(|i| 12.0 * f64::from(i) / f64::from(STEPS));
    let (sum, weight) = points.fold((0.0, 0.0), |(sum, weight), x| {
        let density = (-0.5 * x * x).exp();
        (sum + density * f(mean + deviation * x), weight + density)
    });
    sum / weight
}
