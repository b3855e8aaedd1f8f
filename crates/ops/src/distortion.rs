//! Distortion of the weights along rays.

use burn::tensor::{FloatDType, Tensor};

use crate::Segments;
use crate::composite::{Padding, plain_alpha, working_dtype};
use crate::dispatch::dispatch;

/// The interval of each packed sample, `[M]` each; the distortion is in their unit.
#[derive(Clone, Debug)]
pub struct Intervals {
    /// Its middle m, ascending along each ray.
    pub middle: Tensor<1>,
    /// Its length δ ≥ 0.
    pub length: Tensor<1>,
}

/// Distortion of each ray's weights (mip-NeRF 360, Barron et al. 2022, Eq. 15), `[R]`, differentiable in `tau` and, where
/// `intervals` ask for a gradient, in them:
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
    assert_eq!(tau.dims(), [count], "tau holds one number per packed sample");
    assert_eq!(
        (intervals.middle.dims(), intervals.length.dims()),
        ([count], [count]),
        "one interval per packed sample"
    );
    dispatch! {
        &tau.device();
        host => crate::ray_kernel::apply(host::DistortionKernel { segments: segments.clone() }, (tau, intervals.middle, intervals.length)),
        plain => plain(tau, intervals, segments),
    }
}

/// [`ray_distortion`] from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, intervals: Intervals, segments: &Segments) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::zeros([segments.rays()], &device);
    }
    let dtype = working_dtype(&device);
    let padding = Padding::new(segments, &device);
    let [tau, middle, length] = [tau, intervals.middle, intervals.length].map(|input| padding.apply(input.cast(dtype)));
    let [rays, samples] = tau.dims();
    // Shifted, not subtracted: the depth before a sample that is infinitely deep is finite.
    let nothing = Tensor::<2>::zeros([rays, 1], &device).cast(dtype);
    let before = |terms: Tensor<2>| Tensor::cat(vec![nothing.clone(), terms.narrow(1, 0, samples - 1)], 1).cumsum(1);
    let w = before(tau.clone()).neg().exp() * plain_alpha(tau);
    let between = w.clone() * (middle.clone() * before(w.clone()) - before(w.clone() * middle));
    let within = w.clone() * w * length;
    (between * 2.0 + within / 3.0).sum_dim(1).squeeze_dim::<1>(1).cast(FloatDType::F32)
}

#[cfg(feature = "flex")]
mod host {
    use crate::Segments;
    use crate::groups::Group;
    use crate::numeric::Opacity;
    use crate::ray_kernel::RayKernel;

    #[derive(Debug)]
    pub(super) struct DistortionKernel {
        pub(super) segments: Segments,
    }

    /// A sample as the sums along a ray see it.
    #[derive(Clone, Copy)]
    struct Sample {
        w: f64,
        middle: f64,
        length: f64,
        /// Transmittance behind it.
        behind: f64,
    }

    /// The samples of one ray.
    #[inline(always)]
    fn samples<'a>(
        opacity: &'a Opacity,
        [middle, length]: [&'a [f32]; 2],
        range: std::ops::Range<usize>,
    ) -> impl Iterator<Item = Sample> + 'a {
        let mut trans = 1.0;
        range.map(move |i| {
            let w = trans * opacity.alpha[i];
            trans *= opacity.through[i];
            Sample { w, middle: f64::from(middle[i]), length: f64::from(length[i]), behind: trans }
        })
    }

    /// Of τ, m and δ to one number per ray.
    impl RayKernel<3> for DistortionKernel {
        fn segments(&self) -> &Segments {
            &self.segments
        }

        fn shape(&self) -> Vec<usize> {
            vec![self.segments.rays()]
        }

        #[inline(always)]
        fn forward<const FMA: bool>(&self, group: Group<'_>, [tau, middle, length]: [&[f32]; 3], out: &mut [f32]) {
            let opacity = Opacity::of::<FMA>(tau);
            for (range, out) in group.ranges().zip(out) {
                let (mut weight, mut moment, mut sum) = (0.0, 0.0, 0.0);
                for s in samples(&opacity, [middle, length], range) {
                    sum += s.w * (2.0 * (s.middle * weight - moment) + s.w * s.length / 3.0);
                    weight += s.w;
                    moment += s.w * s.middle;
                }
                *out = sum as f32;
            }
        }

        #[inline(always)]
        fn backward<const FMA: bool>(
            &self,
            group: Group<'_>,
            [tau, middle, length]: [&[f32]; 3],
            grad: &[f32],
            [mut dtau, mut dmiddle, mut dlength]: [Option<&mut [f32]>; 3],
        ) {
            let opacity = Opacity::of::<FMA>(tau);
            let mut ray = Vec::new();
            for (range, grad) in group.ranges().zip(grad).filter(|(_, grad)| **grad != 0.0) {
                let grad = f64::from(*grad);
                ray.clear();
                ray.extend(samples(&opacity, [middle, length], range.clone()));
                let (mut weight, mut moment) =
                    ray.iter().fold((0.0, 0.0), |(weight, moment), s| (weight + s.w, moment + s.w * s.middle));
                let (mut weight_behind, mut moment_behind, mut pulled) = (0.0, 0.0, 0.0);
                for (i, s) in range.zip(&ray).rev() {
                    weight -= s.w;
                    moment -= s.w * s.middle;
                    let away = (s.middle * weight - moment) + (moment_behind - s.middle * weight_behind);
                    let slope = 2.0 * away + 2.0 / 3.0 * s.w * s.length;
                    if let Some(dtau) = &mut dtau {
                        dtau[i] = (grad * (s.behind * slope - pulled)) as f32;
                    }
                    if let Some(dmiddle) = &mut dmiddle {
                        dmiddle[i] = (grad * 2.0 * s.w * (weight - weight_behind)) as f32;
                    }
                    if let Some(dlength) = &mut dlength {
                        dlength[i] = (grad * s.w * s.w / 3.0) as f32;
                    }
                    pulled += s.w * slope;
                    weight_behind += s.w;
                    moment_behind += s.w * s.middle;
                }
            }
        }
    }
}
