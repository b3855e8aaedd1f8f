//! The additive march of Neural Volumes, as optical depths.

use burn::tensor::{FloatDType, Tensor};

use crate::composite::{Padding, working_dtype};
use crate::dispatch::dispatch;
use crate::{Segments, upload};

/// Optical depths τ′ whose [compositing](crate::composite()) is the additive march of Neural Volumes (Lombardi et al. 2019,
/// Eq. 7), `[M]`, differentiable in `tau`.
///
/// There a sample adds `wᵢ = min(Aᵢ + τᵢ, 1) − Aᵢ` to the opacity `Aᵢ = Σ_{j<i} wⱼ` in front of it: the weights are the
/// optical depths themselves until their sum reaches 1. Compositing has `wᵢ = (1 − Aᵢ)(1 − e^−τ′ᵢ)`, so the same weights
/// follow from
///
/// `τ′ᵢ = −ln(1 − τᵢ/(1 − Aᵢ))`,
///
/// which is infinite for the sample that fills the ray, and 0 for those behind it. Whatever is defined on optical depths
/// (entropy, distortion, importance sampling) thus serves the additive march too. The gradient is 0 for the sample that
/// fills the ray and those behind it, as in PyTorch's `clamp`.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
///
/// # Panics
/// If `tau` does not match `segments`.
///
/// # Examples
/// Three samples of 0.4: the third has room for 0.2.
/// ```
/// # #[cfg(feature = "flex")] {
/// use burn::tensor::{Device, Tensor};
/// use infonerf_ops::{Segments, additive_depth, composite::weights, to_host};
///
/// let rays = Segments::from_counts([3]);
/// let depths = additive_depth(Tensor::from_floats([0.4, 0.4, 0.4], &Device::flex()), &rays);
/// let w = weights(&to_host(depths), &rays);
/// assert!(w.iter().zip([0.4, 0.4, 0.2]).all(|(w, expected)| (w - expected).abs() < 1e-6));
/// # }
/// ```
pub fn additive_depth(tau: Tensor<1>, segments: &Segments) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number per packed sample");
    dispatch! {
        &tau.device();
        host => crate::kernel::apply(host::AdditiveKernel { segments: segments.clone() }, tau),
        plain => plain(tau, segments),
    }
}

/// [`additive_depth`] from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, segments: &Segments) -> Tensor<1> {
    if segments.samples() == 0 {
        return tau;
    }
    let device = tau.device();
    let dtype = working_dtype(&device);
    let tau = Padding::new(segments, &device).apply(tau.cast(dtype));
    let [rays, longest] = tau.dims();
    let nothing = tau.clone().narrow(1, 0, 1).zeros_like();
    let before = Tensor::cat(vec![nothing, tau.clone().narrow(1, 0, longest - 1)], 1).cumsum(1);
    let room = before.neg() + 1.0;
    let full = tau.clone().greater_equal(room.clone());
    let behind = room.clone().lower_equal_elem(0.0);
    // Masked before they are divided: what is discarded later must not be infinite.
    let share = tau.mask_fill(full.clone(), 0.0) / room.mask_fill(full.clone(), 1.0);
    let depth = share.neg().log1p().neg().mask_fill(full, f32::INFINITY).mask_fill(behind, 0.0);
    let packed =
        segments.ranges().enumerate().flat_map(|(ray, range)| (0..range.len()).map(move |i| ray * longest + i));
    let packed: Vec<i32> = packed.map(|index| index as i32).collect();
    let count = packed.len();
    let depth = depth.reshape([rays * longest]).select(0, upload(packed, [count], &device)).cast(FloatDType::F32);
    match segments.samples() - count {
        0 => depth,
        // Samples of no ray.
        tail => Tensor::cat(vec![depth, Tensor::zeros([tail], &device)], 0),
    }
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use crate::Segments;
    use crate::groups::Group;
    use crate::kernel::{Kernel, Pass};

    #[derive(Debug)]
    pub(super) struct AdditiveKernel {
        pub(super) segments: Segments,
    }

    impl AdditiveKernel {
        /// `of(ray's tau, ray's part of out, ray's first sample)` for each ray.
        fn each_ray(&self, tau: &[f32], out: &mut [f32], of: impl Fn(&[f32], &mut [f32], usize) + Sync) {
            let groups: Vec<(Group<'_>, &mut [f32])> =
                self.segments.groups().zip(self.segments.split_mut(out, 1)).collect();
            groups.into_par_iter().for_each(|(group, out)| {
                let first = group.samples().start;
                let tau = &tau[group.samples()];
                for range in group.ranges() {
                    of(&tau[range.clone()], &mut out[range.clone()], first + range.start);
                }
            });
        }
    }

    impl Kernel for AdditiveKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![self.segments.samples()]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let tau = inputs[0];
            let mut out = vec![0.0; tau.len()];
            self.each_ray(tau, &mut out, |tau, out, _| {
                let mut room = 1f64;
                for (tau, out) in tau.iter().zip(out) {
                    let tau = f64::from(*tau);
                    if tau >= room {
                        *out = f32::INFINITY;
                        break;
                    }
                    *out = -(-tau / room).ln_1p() as f32;
                    room -= tau;
                }
            });
            out
        }

        fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let tau = pass.inputs[0];
            let mut dtau = vec![0.0; tau.len()];
            self.each_ray(tau, &mut dtau, |tau, dtau, first| {
                // 1 − A behind each sample up to the one that fills the ray.
                let mut room = Vec::with_capacity(tau.len());
                let mut left = 1f64;
                for tau in tau {
                    left -= f64::from(*tau);
                    if left <= 0.0 {
                        break;
                    }
                    room.push(left);
                }
                // With τ′ᵢ = ln(room before i) − ln(room behind i): dL/dτⱼ = Σ_{i≥j} (gᵢ − gᵢ₊₁)/room behind i.
                let (mut sum, mut behind) = (0f64, 0f64);
                for (i, room) in room.iter().enumerate().rev() {
                    let grad = f64::from(pass.grad[first + i]);
                    sum += (grad - behind) / room;
                    behind = grad;
                    dtau[i] = sum as f32;
                }
            });
            vec![Some(dtau)]
        }
    }
}
