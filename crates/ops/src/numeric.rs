//! Scalar functions that stay accurate over the whole range of optical depths.

/// `1 − e^−τ` without cancellation: `−expm1(−τ)`.
pub fn alpha(tau: f32) -> f32 {
    -(-tau).exp_m1()
}
