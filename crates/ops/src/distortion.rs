//! Distortion of the weights along rays.

use burn::tensor::{FloatDType, Tensor, TensorData};

use crate::composite::{Padding, plain_alpha, working_dtype};
use crate::{Segments, has_host_kernels};

/// The interval of each packed sample, `[M]` each, in whatever unit the distortion is to be measured in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intervals {
    /// Its middle, ascending along each ray.
    pub middle: Vec<f32>,
    /// Its length ≥ 0.
    pub length: Vec<f32>,
}

/// Distortion of each ray's weights (mip-NeRF 360, Barron et al. 2022, Eq. 15), `[R]`, differentiable in `tau`:
///
/// `L = Σᵢⱼ wᵢ wⱼ |mᵢ − mⱼ| + ⅓ Σᵢ wᵢ² δᵢ`, with `wᵢ = Tᵢ (1 − e^−τᵢ)`.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
/// - `intervals`: the middles m and lengths δ of the same samples.
///
/// The double sum takes O(N): with `mᵢ` ascending it is `2 Σᵢ wᵢ (mᵢ W − M)`, where W and M are the sums of `wⱼ` and
/// `wⱼ mⱼ` before i. The gradient is `∂L/∂τᵢ = Tᵢ₊₁ gᵢ − Σ_{j>i} wⱼ gⱼ` with
/// `gᵢ = ∂L/∂wᵢ = 2 Σⱼ wⱼ |mᵢ − mⱼ| + ⅔ wᵢ δᵢ`. Both are finite for every τ in [0, ∞].
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
/// let tau = Tensor::<1>::from_floats([half, half], &Device::flex());
/// let intervals = Intervals { middle: vec![0.0, 1.0], length: vec![0.0; 2] };
/// let distortion = ray_distortion(tau, &intervals, &Segments::from_counts([2]));
/// assert!((distortion.into_scalar::<f32>() - 2.0 * 0.5 * 0.25).abs() < 1e-6);
/// # }
/// ```
pub fn ray_distortion(tau: Tensor<1>, intervals: &Intervals, segments: &Segments) -> Tensor<1> {
    let count = segments.samples();
    assert_eq!(tau.dims(), [count], "tau holds one number per packed sample");
    assert_eq!((intervals.middle.len(), intervals.length.len()), (count, count), "one interval per packed sample");
    #[cfg(feature = "flex")]
    if has_host_kernels(&tau.device()) {
        let kernel = host::DistortionKernel { segments: segments.clone(), intervals: intervals.clone() };
        return crate::kernel::apply1(kernel, tau);
    }
    let _ = has_host_kernels;
    plain(tau, intervals, segments)
}

/// The same from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, intervals: &Intervals, segments: &Segments) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::zeros([segments.rays()], &device);
    }
    let dtype = working_dtype(&device);
    let padding = Padding::new(segments, &device);
    let constant = |values: &[f32]| {
        let data = TensorData::new(values.to_vec(), [values.len()]);
        padding.apply(Tensor::<1>::from_data(data, &device).cast(dtype))
    };
    let (middle, length) = (constant(&intervals.middle), constant(&intervals.length));
    let tau = padding.apply(tau.cast(dtype));
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
    use rayon::prelude::*;

    use super::Intervals;
    use crate::Segments;
    use crate::groups::{GROUP, Group};
    use crate::kernel::{Kernel, Pass};
    use crate::numeric::Opacity;
    use crate::simd::{self, Job};

    #[derive(Debug)]
    pub(super) struct DistortionKernel {
        pub(super) segments: Segments,
        pub(super) intervals: Intervals,
    }

    impl Kernel for DistortionKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![self.segments.rays()]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let mut out = vec![0.0; self.segments.rays()];
            self.segments.groups().zip(out.par_chunks_mut(GROUP)).for_each(|(group, out)| {
                simd::run(Forward { kernel: self, tau: &inputs[0][group.samples()], group, out });
            });
            out
        }

        fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let tau = pass.inputs[0];
            let mut dtau = vec![0.0; tau.len()];
            (self.segments.groups())
                .zip(self.segments.split_mut(&mut dtau, 1))
                .zip(pass.grad.par_chunks(GROUP))
                .for_each(|((group, dtau), grad)| {
                    simd::run(Backward { kernel: self, tau: &tau[group.samples()], group, grad, dtau });
                });
            vec![Some(dtau)]
        }
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

    impl DistortionKernel {
        /// The samples of one ray, whose first is number `start` of all.
        fn samples<'a>(
            &'a self,
            start: usize,
            alpha: &'a [f64],
            through: &'a [f64],
        ) -> impl Iterator<Item = Sample> + 'a {
            let mut trans = 1.0;
            alpha.iter().zip(through).enumerate().map(move |(i, (alpha, through))| {
                let w = trans * alpha;
                trans *= through;
                let of = |values: &[f32]| f64::from(values[start + i]);
                Sample { w, middle: of(&self.intervals.middle), length: of(&self.intervals.length), behind: trans }
            })
        }
    }

    struct Forward<'a> {
        kernel: &'a DistortionKernel,
        group: Group<'a>,
        tau: &'a [f32],
        out: &'a mut [f32],
    }

    impl Job for Forward<'_> {
        #[inline(always)]
        fn run<const FMA: bool>(self) {
            let Self { kernel, group, tau, out } = self;
            let opacity = Opacity::of::<FMA>(tau);
            let first = group.samples().start;
            for (range, out) in group.ranges().zip(out) {
                let (mut weight, mut moment, mut sum) = (0.0, 0.0, 0.0);
                let start = first + range.start;
                for s in kernel.samples(start, &opacity.alpha[range.clone()], &opacity.through[range]) {
                    sum += s.w * (2.0 * (s.middle * weight - moment) + s.w * s.length / 3.0);
                    weight += s.w;
                    moment += s.w * s.middle;
                }
                *out = sum as f32;
            }
        }
    }

    struct Backward<'a> {
        kernel: &'a DistortionKernel,
        group: Group<'a>,
        tau: &'a [f32],
        grad: &'a [f32],
        dtau: &'a mut [f32],
    }

    impl Job for Backward<'_> {
        #[inline(always)]
        fn run<const FMA: bool>(self) {
            let Self { kernel, group, tau, grad, dtau } = self;
            let opacity = Opacity::of::<FMA>(tau);
            let first = group.samples().start;
            let mut samples = Vec::new();
            for (range, grad) in group.ranges().zip(grad).filter(|(_, grad)| **grad != 0.0) {
                let start = first + range.start;
                samples.clear();
                samples.extend(kernel.samples(start, &opacity.alpha[range.clone()], &opacity.through[range.clone()]));
                let (mut weight, mut moment) =
                    samples.iter().fold((0.0, 0.0), |(weight, moment), s| (weight + s.w, moment + s.w * s.middle));
                let (mut weight_behind, mut moment_behind, mut pulled) = (0.0, 0.0, 0.0);
                for (s, dtau) in samples.iter().zip(&mut dtau[range]).rev() {
                    weight -= s.w;
                    moment -= s.w * s.middle;
                    let away = (s.middle * weight - moment) + (moment_behind - s.middle * weight_behind);
                    let slope = 2.0 * away + 2.0 / 3.0 * s.w * s.length;
                    *dtau = (f64::from(*grad) * (s.behind * slope - pulled)) as f32;
                    pulled += s.w * slope;
                    weight_behind += s.w;
                    moment_behind += s.w * s.middle;
                }
            }
        }
    }
}
