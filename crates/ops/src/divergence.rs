//! Divergence of the distributions along neighbouring rays: InfoNeRF's information gain.

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
pub fn ray_divergence(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number per packed sample");
    assert_eq!(near.dims(), [segments.samples()], "near holds one number per packed sample");
    assert!(epsilon > 0.0, "epsilon must be positive: it bounds the divergence");
    #[cfg(feature = "flex")]
    if has_host_kernels(&tau.device()) {
        return crate::kernel::apply2(host::DivergenceKernel { segments: segments.clone(), epsilon }, tau, near);
    }
    #[cfg(feature = "cube")]
    if crate::cube::serves(&tau.device()) && segments.samples() > 0 {
        return crate::cube::divergence(tau, near, segments, epsilon);
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
    let terms = b.clone() * (ln.clone() * (r.clone() + 1.0) - r.clone()) - ln.clone() * epsilon;
    // The slopes are of Σ p (ln a − ln b), less what all of a ray's have in common, as Σ p and Σ q are fixed: of 1 − ε/a
    // and of r + 1 − ε/b the ones, in which the rest would lose its digits.
    let slopes = p.clone() * (ln - (p + epsilon).recip() * epsilon).detach() + q * (b.recip() * epsilon - r).detach();
    let terms = terms.detach() + (slopes.clone() - slopes.detach());
    terms.sum_dim(1).mask_fill(p_missed, 0.0).mask_fill(q_missed, 0.0).squeeze_dim::<1>(1).cast(FloatDType::F32)
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use crate::distribution::Distributions;
    use crate::groups::{GROUP, Group};
    use crate::kernel::{Kernel, Pass};
    use crate::numeric::Opacity;
    use crate::simd::{self, Job};
    use crate::{RayDistribution, Segments};

    const ALPHA: RayDistribution = RayDistribution::Alpha;

    #[derive(Debug)]
    pub(super) struct DivergenceKernel {
        pub(super) segments: Segments,
        pub(super) epsilon: f32,
    }

    impl DivergenceKernel {
        fn pairs<'a>(&self, group: Group<'a>, inputs: &[&'a [f32]]) -> Pairs<'a> {
            let &[tau, near] = inputs else { unreachable!("a divergence has two inputs") };
            let samples = group.samples();
            Pairs { group, tau: &tau[samples.clone()], near: &near[samples], epsilon: self.epsilon }
        }
    }

    impl Kernel for DivergenceKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![self.segments.rays()]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let mut out = vec![0.0; self.segments.rays()];
            let groups = self.segments.groups().zip(out.par_chunks_mut(GROUP));
            groups.for_each(|(group, out)| simd::run(Forward { pairs: self.pairs(group, inputs), out }));
            out
        }

        fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let Pass { inputs, grad, .. } = pass;
            let (mut dtau, mut dnear) = (vec![0.0; inputs[0].len()], vec![0.0; inputs[1].len()]);
            (self.segments.groups())
                .zip(self.segments.split_mut(&mut dtau, 1))
                .zip(self.segments.split_mut(&mut dnear, 1))
                .zip(grad.par_chunks(GROUP))
                .for_each(|(((group, dtau), dnear), grad)| {
                    simd::run(Backward { pairs: self.pairs(group, inputs), grad, dtau, dnear });
                });
            vec![wanted[0].then_some(dtau), wanted[1].then_some(dnear)]
        }
    }

    /// A group of rays and their neighbours.
    struct Pairs<'a> {
        group: Group<'a>,
        tau: &'a [f32],
        near: &'a [f32],
        epsilon: f32,
    }

    struct Forward<'a> {
        pairs: Pairs<'a>,
        out: &'a mut [f32],
    }

    impl Job for Forward<'_> {
        #[inline(always)]
        fn run<const FMA: bool>(self) {
            let Pairs { group, tau, near, epsilon } = self.pairs;
            let (tau, near) = (Opacity::of::<FMA>(tau), Opacity::of::<FMA>(near));
            let (p, q) = (Distributions::new(&tau, &group, ALPHA), Distributions::new(&near, &group, ALPHA));
            p.divergences::<FMA>(&q, epsilon, self.out);
        }
    }

    struct Backward<'a> {
        pairs: Pairs<'a>,
        grad: &'a [f32],
        dtau: &'a mut [f32],
        dnear: &'a mut [f32],
    }

    impl Job for Backward<'_> {
        #[inline(always)]
        fn run<const FMA: bool>(self) {
            let Pairs { group, tau, near, epsilon } = self.pairs;
            let (tau, near) = (Opacity::of::<FMA>(tau), Opacity::of::<FMA>(near));
            let (p, q) = (Distributions::new(&tau, &group, ALPHA), Distributions::new(&near, &group, ALPHA));
            p.divergence_gradients::<FMA>(&q, epsilon, self.grad, (self.dtau, self.dnear));
        }
    }
}
