//! Conical frustums as Gaussians (mip-NeRF, Sec. 3.1).

use burn::tensor::Tensor;

/// Gaussians on rays: distances of their means, and variances along the rays and across.
#[derive(Clone, Debug)]
pub struct RayGaussians {
    /// Distance of each mean along its ray, `[M]`, scene units.
    pub mean: Tensor<1>,
    /// Variance along the ray, `[M]`, scene units².
    pub along: Tensor<1>,
    /// Variance along either axis across the ray, `[M]`, scene units².
    pub across: Tensor<1>,
}

/// Computes means and variances of frustums of cones around rays (mip-NeRF, Eq. 7). Their middles are at distances `t`, their
/// lengths are `delta`, and a cone has `radius` at distance 1; `[M]` each.
///
/// With h = δ/2 and D = 3t² + h²: μ = t + 2th²/D, σ_t² = h²/3 − 4h⁴(12t² − h²)/(15D²),
/// σ_r² = ṙ²(t²/4 + 5h²/12 − 4h⁴/(15D)). These forms are corrections to the moments of a segment, which keep their digits
/// for a short frustum far away. The equal quotients of fourth and fifth powers lose them.
pub fn frustum_gaussians(t: Tensor<1>, delta: Tensor<1>, radius: Tensor<1>) -> RayGaussians {
    let (t2, h2) = (t.clone().square(), (delta * 0.5).square());
    // A frustum without length at the apex is a point.
    let d = (t2.clone() * 3.0 + h2.clone()).clamp_min(f32::MIN_POSITIVE);
    // h²/D, at most 1, so that no fourth power is formed.
    let share = h2.clone() / d;
    let across = t2.clone() * 0.25 + h2.clone() * (5.0 / 12.0) - h2.clone() * share.clone() * (4.0 / 15.0);
    RayGaussians {
        mean: t.clone() + t * share.clone() * 2.0,
        along: h2.clone() / 3.0 - share.square() * (t2 * 12.0 - h2) * (4.0 / 15.0),
        across: radius.square() * across,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use burn::tensor::Device;

    use super::*;
    use crate::traffic::to_host;

    fn moments(t: f32, delta: f32, radius: f32) -> [f32; 3] {
        let [t, delta, radius] = [t, delta, radius].map(|number| Tensor::from_floats([number], &Device::flex()));
        let RayGaussians { mean, along, across } = frustum_gaussians(t, delta, radius);
        [mean, along, across].map(|tensor| to_host(tensor)[0])
    }

    #[test]
    fn frustum_without_length_at_the_apex_is_a_point() {
        assert_eq!(moments(0.0, 0.0, 0.1), [0.0; 3]);
    }

    #[test]
    fn gradients_are_differences_of_the_exact_moments() {
        let weighted = |[mean, along, across]: [f64; 3]| 0.7 * mean - 1.3 * along + 0.4 * across;
        let exact = |[t, delta, radius]: [f64; 3]| {
            weighted(infonerf_oracle::frustum_moments(t - 0.5 * delta, t + 0.5 * delta, radius))
        };
        for x in [[0.5, 0.8, 0.1], [2.0, 0.1, 0.5], [4.0, 1.0, 0.02], [1.0, 2.0, 0.3]] {
            let device = Device::flex().autodiff();
            let inputs = x.map(|value: f64| Tensor::<1>::from_floats([value], &device).require_grad());
            let [t, delta, radius] = inputs.clone();
            let RayGaussians { mean, along, across } = frustum_gaussians(t, delta, radius);
            let gradients = (mean * 0.7 - along * 1.3 + across * 0.4).backward();
            for (which, input) in inputs.iter().enumerate() {
                let moved = |by: f64| {
                    let mut x = x;
                    x[which] += by;
                    exact(x)
                };
                let want = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                let got = f64::from(to_host(input.grad(&gradients).unwrap())[0]);
                assert!((got - want).abs() <= 2e-5 * (1.0 + want.abs()), "{x:?}, input {which}: {got} against {want}");
            }
        }
    }

    proptest! {
        #[test]
        fn gaussian_has_the_moments_of_the_frustum(near in 0f32..10.0, length in 0.01f32..10.0, radius in 1e-4f32..0.1) {
            let (t, delta) = (near + 0.5 * length, length);
            let edge = |side: f64| f64::from(t) + side * f64::from(delta);
            let want = infonerf_oracle::frustum_moments(edge(-0.5).max(0.0), edge(0.5), radius.into());
            for (got, want) in moments(t, delta, radius).into_iter().zip(want) {
                prop_assert!((f64::from(got) - want).abs() <= 1e-5 * want, "{got} against {want}");
            }
        }

        #[test]
        fn variance_is_accurate_far_away(t in 10f32..1000.0, delta in 1e-4f32..1e-2) {
            let [mean, along, _] = moments(t, delta, 1e-3);
            let segment = f64::from(delta).powi(2) / 12.0;
            prop_assert!((f64::from(along) / segment - 1.0).abs() < 1e-5);
            prop_assert!((mean - t).abs() <= delta);
        }
    }
}
