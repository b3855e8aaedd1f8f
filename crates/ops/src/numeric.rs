//! Scalar functions that stay accurate over the whole range of optical depths.

/// `1 − e^−τ` without cancellation: `−expm1(−τ)`.
pub fn alpha(tau: f32) -> f32 {
    -(-tau).exp_m1()
}

/// `ln(1 − e^−τ)`, finite for every τ ≥ 0: an empty sample gives `ln` of the smallest normal number.
///
/// For τ ≤ ln 2 this is `ln(−expm1(−τ))`, above it `ln_1p(−e^−τ)` (Mächler 2012), so neither end loses digits.
pub fn ln_alpha(tau: f32) -> f32 {
    let tau = tau.max(f32::MIN_POSITIVE);
    if tau <= std::f32::consts::LN_2 { alpha(tau).max(f32::MIN_POSITIVE).ln() } else { (-(-tau).exp()).ln_1p() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ln_alpha_matches_f64() {
        for e in -37..39 {
            for m in [1.0, 1.7, 3.1, 6.9, 9.9] {
                let tau = (m * 10f64.powi(e)) as f32;
                if !tau.is_finite() || tau < f32::MIN_POSITIVE {
                    continue;
                }
                let t = f64::from(tau);
                let exact = if t < 0.7 { (-(-t).exp_m1()).ln() } else { (-(-t).exp()).ln_1p() };
                let error = (f64::from(ln_alpha(tau)) - exact).abs();
                assert!(error <= 1e-6 * exact.abs().max(1e-30) + 1e-37, "tau {tau}: {} against {exact}", ln_alpha(tau));
            }
        }
        assert!(ln_alpha(0.0).is_finite());
    }
}
