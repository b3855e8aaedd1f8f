//! Conical frustums as Gaussians (mip-NeRF, Sec. 3.1).

/// A Gaussian on a ray: where its mean is, and how wide it is along the ray and across.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayGaussian {
    /// Distance of the mean along the ray, scene units.
    pub mean: f32,
    /// Variance along the ray, scene units².
    pub along: f32,
    /// Variance along either axis across the ray, scene units².
    pub across: f32,
}

/// Mean and variances of the piece of a cone around a ray whose middle is at distance `t` and whose length is `delta`, with
/// `radius` the cone's at distance 1 (mip-NeRF, Eq. 7).
///
/// With h = δ/2 and D = 3t² + h²: μ = t + 2th²/D, σ_t² = h²/3 − 4h⁴(12t² − h²)/(15D²),
/// σ_r² = ṙ²(t²/4 + 5h²/12 − 4h⁴/(15D)). These are differences from a segment's moments, so that a short piece far away
/// loses no digits, as the quotients of fourth and fifth powers that they equal do.
pub fn frustum_gaussian(t: f32, delta: f32, radius: f32) -> RayGaussian {
    let half = 0.5 * delta;
    let (t2, h2) = (t * t, half * half);
    // A piece without length at the apex is a point.
    let d = (3.0 * t2 + h2).max(f32::MIN_POSITIVE);
    // Never above 1: h²/D, so that no fourth power is formed.
    let share = h2 / d;
    RayGaussian {
        mean: t + 2.0 * t * share,
        along: h2 / 3.0 - 4.0 / 15.0 * share * share * (12.0 * t2 - h2),
        across: radius * radius * (0.25 * t2 + 5.0 / 12.0 * h2 - 4.0 / 15.0 * h2 * share),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::reference;

    #[test]
    fn a_point_at_the_apex() {
        assert_eq!(frustum_gaussian(0.0, 0.0, 0.1), RayGaussian { mean: 0.0, along: 0.0, across: 0.0 });
    }

    proptest! {
        #[test]
        fn matches_the_moments(near in 0f32..10.0, length in 0.01f32..10.0, radius in 1e-4f32..0.1) {
            let (t, delta) = (near + 0.5 * length, length);
            let got = frustum_gaussian(t, delta, radius);
            let edge = |side: f64| f64::from(t) + side * f64::from(delta);
            let want = reference::frustum_moments(edge(-0.5).max(0.0), edge(0.5), radius.into());
            for (got, want) in [got.mean, got.along, got.across].into_iter().zip(want) {
                prop_assert!((f64::from(got) - want).abs() <= 1e-5 * want, "{got} against {want}");
            }
        }

        /// A thousandth of a unit, a thousand units away: the length's square in f32 is what is left of the variance.
        #[test]
        fn keeps_its_digits_far_away(t in 10f32..1000.0, delta in 1e-4f32..1e-2) {
            let got = frustum_gaussian(t, delta, 1e-3);
            let segment = f64::from(delta).powi(2) / 12.0;
            prop_assert!((f64::from(got.along) / segment - 1.0).abs() < 1e-5);
            prop_assert!((got.mean - t).abs() <= delta);
        }
    }
}
