//! Distortion of the weights along rays.

#[cfg(feature = "flex")]
mod host;
mod plain;

use burn::tensor::Tensor;

pub use self::plain::plain;
use crate::Segments;
use crate::dispatch::dispatch;

/// The interval of each packed sample, `[M]` each; the distortion is in their unit.
#[derive(Clone, Debug)]
pub struct Intervals {
    /// Middle m of the interval, ascending along each ray.
    pub middle: Tensor<1>,
    /// Length δ ≥ 0 of the interval.
    pub length: Tensor<1>,
}

/// Computes the distortion of each ray's weights (mip-NeRF 360, Barron et al. 2022, Eq. 15), `[R]`, differentiable in `tau` and
/// `intervals`:
///
/// `L = Σᵢⱼ wᵢ wⱼ |mᵢ − mⱼ| + ⅓ Σᵢ wᵢ² δᵢ`, with `wᵢ = Tᵢ (1 − e^−τᵢ)`.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
/// - `intervals`: the middles m and lengths δ of the same samples.
///
/// The double sum takes O(N): with `mᵢ` ascending it is `2 Σᵢ wᵢ (mᵢ W − M)`, where W and M are the sums of `wⱼ` and
/// `wⱼ mⱼ` before i. The gradient is `∂L/∂τᵢ = Tᵢ₊₁ gᵢ − Σ_{j>i} wⱼ gⱼ` with
/// `gᵢ = ∂L/∂wᵢ = 2 Σⱼ wⱼ |mᵢ − mⱼ| + ⅔ wᵢ δᵢ`; `∂L/∂mᵢ = 2 wᵢ (Σ_{j<i} wⱼ − Σ_{j>i} wⱼ)` and `∂L/∂δᵢ = ⅓ wᵢ²`. All are
/// finite for every τ in [0, ∞].
///
/// # Panics
/// If `tau` or `intervals` does not match `segments`.
///
/// # Examples
/// Half of the light ends at 0 and half of the rest at 1, in intervals without length:
/// ```
/// # #[cfg(feature = "flex")] {
/// use burn::tensor::{Device, Tensor};
/// use infonerf_ops::{Intervals, Segments, ray_distortion};
///
/// let half = std::f32::consts::LN_2;
/// let device = Device::flex();
/// let tau = Tensor::<1>::from_floats([half, half], &device);
/// let intervals = Intervals { middle: Tensor::from_floats([0.0, 1.0], &device), length: Tensor::zeros([2], &device) };
/// let distortion = ray_distortion(tau, intervals, &Segments::from_counts([2]));
/// assert!((distortion.into_scalar::<f32>() - 2.0 * 0.5 * 0.25).abs() < 1e-6);
/// # }
/// ```
pub fn ray_distortion(tau: Tensor<1>, intervals: Intervals, segments: &Segments) -> Tensor<1> {
    let count = segments.samples();
    assert_eq!(tau.dims(), [count], "tau holds one value per packed sample");
    assert_eq!(
        (intervals.middle.dims(), intervals.length.dims()),
        ([count], [count]),
        "one interval per packed sample"
    );
    dispatch! {
        &tau.device();
        host => {
            let inputs = (tau, intervals.middle, intervals.length);
            crate::ray_kernel::apply(host::DistortionKernel, segments, [segments.rays()], inputs)
        },
        plain => plain(tau, intervals, segments),
    }
}
