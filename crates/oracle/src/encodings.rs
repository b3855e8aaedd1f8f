//! Positional encodings and their Gaussians.

/// Computes (sin 2ˡx, cos 2ˡx) · w_l · exp(−½ 4ˡσ²) for each frequency l: one coordinate's part of an encoding.
pub fn waves(x: f64, variance: f64, window: &[f64]) -> Vec<[f64; 2]> {
    let wave = |(l, weight): (usize, &f64)| {
        let scale = 2f64.powi(l as i32);
        let fading = weight * (-0.5 * scale * scale * variance).exp();
        [fading * (scale * x).sin(), fading * (scale * x).cos()]
    };
    window.iter().enumerate().map(wave).collect()
}

/// Computes the gradients of Σ u · [`waves`] with respect to x and σ².
pub fn waves_gradient(x: f64, variance: f64, window: &[f64], u: &[[f64; 2]]) -> [f64; 2] {
    let terms = waves(x, variance, window).into_iter().zip(u).enumerate().map(|(l, ([sine, cosine], u))| {
        let scale = 2f64.powi(l as i32);
        [scale * (u[0] * cosine - u[1] * sine), -0.5 * scale * scale * (u[0] * sine + u[1] * cosine)]
    });
    terms.fold([0.0; 2], |sum, term| [sum[0] + term[0], sum[1] + term[1]])
}

/// Computes mean distance, variance along the ray and variance across it of a cone's frustum between `t0` and `t1`, as
/// quotients of integrals over its volume (mip-NeRF, Eq. 29–37). The cone's cross-section grows as t².
pub fn frustum_moments(t0: f64, t1: f64, radius: f64) -> [f64; 3] {
    // Gauss–Legendre quadrature with 4 nodes is exact for tⁿ up to n = 7, without differences of large powers.
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
