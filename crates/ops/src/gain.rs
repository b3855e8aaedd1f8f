//! Information gain between neighbouring rays.

use burn::tensor::{FloatDType, Tensor, TensorData};

use crate::composite::{MIN_ALPHA_SUM, Padding, plain_alpha, working_dtype};
use crate::{Segments, has_host_kernels};

/// KL(P(r) ‖ P(r̃)) of paired rays in nats (InfoNeRF, Eq. 9), `[R]`.
///
/// KL = Σ pᵢ [ln(pᵢ + ε) − ln(qᵢ + ε)] with p = α/Σα of `tau` and q the same of `near`; samples are paired by index.
/// `epsilon` > 0 bounds the divergence of disjoint rays at −ln ε nats (the released code has 1e-10). A pair in which
/// either ray hits nothing (Σα < 1e-20) gives 0 with zero gradient.
///
/// - `tau`, `near`: optical depths, both `[M]` and shared out by the same `segments`.
///
/// For the reverse direction of the released code swap the arguments.
///
/// # Panics
/// If the shapes do not match `segments`, or `epsilon` is not positive.
pub fn information_gain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number a packed sample");
    assert_eq!(near.dims(), [segments.samples()], "near holds one number a packed sample");
    assert!(epsilon > 0.0, "epsilon must be positive: it bounds the divergence");
    #[cfg(feature = "flex")]
    if has_host_kernels(&tau.device()) {
        return crate::kernel::apply2(host::GainKernel { segments: segments.clone(), epsilon }, tau, near);
    }
    let _ = has_host_kernels;
    plain(tau, near, segments, epsilon)
}

/// The same from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::from_data(TensorData::new(vec![0f32; segments.rays()], [segments.rays()]), &device);
    }
    let padding = Padding::new(segments, &device);
    let density = |tau: Tensor<1>| {
        let alpha = plain_alpha(padding.apply(tau.cast(working_dtype(&device))));
        let sum = alpha.clone().sum_dim(1);
        let missed = sum.clone().lower_elem(MIN_ALPHA_SUM);
        (alpha / sum.mask_fill(missed.clone(), 1.0), missed)
    };
    let (p, p_missed) = density(tau);
    let (q, q_missed) = density(near);
    // Σ (p − q) = 0 is taken off term by term: with a = p + ε, b = q + ε and r = (p − q)/b a sum of b [(1 + r) ln(1 + r) − r]
    // remains, less ε ln(a/b). Each is of second order where p ≈ q, and nothing cancels.
    let b = q.clone() + epsilon;
    let r = (p.clone() - q.clone()) / b.clone();
    let near = r.clone().abs().lower_elem(0.5);
    let ln = ((p.clone() + epsilon) / b.clone()).log().mask_where(near, r.clone().clamp(-0.5, 0.5).log1p());
    let terms = b * (ln.clone() * (r.clone() + 1.0) - r) - ln * epsilon;
    // The slopes are those of Σ p (ln a − ln b), which are simple: of it only they are taken.
    let textbook = p.clone() * ((p + epsilon).log() - (q + epsilon).log());
    let terms = terms.detach() + (textbook.clone() - textbook.detach());
    terms.sum_dim(1).mask_fill(p_missed, 0.0).mask_fill(q_missed, 0.0).squeeze_dim::<1>(1).cast(FloatDType::F32)
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use crate::Segments;
    use crate::distribution::Distribution;
    use crate::kernel::{Kernel, Pass};

    #[derive(Debug)]
    pub(super) struct GainKernel {
        pub(super) segments: Segments,
        pub(super) epsilon: f32,
    }

    impl GainKernel {
        /// Both distributions; none if either ray hits nothing.
        fn pair(&self, tau: &[f32], near: &[f32]) -> Option<(Distribution, Distribution)> {
            Some((Distribution::new(tau, self.epsilon)?, Distribution::new(near, self.epsilon)?))
        }
    }

    impl Kernel for GainKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![self.segments.rays()]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let &[tau, near] = inputs else { unreachable!("information gain has two inputs") };
            (0..self.segments.rays())
                .into_par_iter()
                .with_min_len(64)
                .map(|ray| {
                    let range = self.segments.range(ray);
                    let pair = self.pair(&tau[range.clone()], &near[range]);
                    pair.map_or(0.0, |(p, q)| p.divergence(&q) as f32)
                })
                .collect()
        }

        fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let Pass { inputs, grad, .. } = pass;
            let &[tau, near] = inputs else { unreachable!("information gain has two inputs") };
            let (mut dtau, mut dnear) = (vec![0.0; tau.len()], vec![0.0; near.len()]);
            self.segments
                .split_mut(&mut dtau, 1)
                .into_par_iter()
                .zip(self.segments.split_mut(&mut dnear, 1))
                .enumerate()
                .with_min_len(64)
                .for_each(|(ray, (dtau, dnear))| {
                    let range = self.segments.range(ray);
                    let rays = (&tau[range.clone()], &near[range]);
                    if let Some((p, q)) = self.pair(rays.0, rays.1) {
                        p.divergence_gradient(&q, rays, f64::from(grad[ray]), (dtau, dnear));
                    }
                });
            vec![wanted[0].then_some(dtau), wanted[1].then_some(dnear)]
        }
    }
}
