//! Divergence of the distributions along neighbouring rays: InfoNeRF's information gain.

use burn::tensor::{FloatDType, Tensor};

use crate::Segments;
use crate::composite::{MIN_ALPHA_SUM, Padding, plain_alpha, working_dtype};
use crate::dispatch::dispatch;

/// KL(P(r) ‖ P(r̃)) of paired rays in nats (InfoNeRF, Eq. 9), `[R]`.
///
/// KL = Σ pᵢ [ln(pᵢ + ε) − ln(qᵢ + ε)] with p = α/Σα of `tau` and q the same of `near`; samples are paired by index.
/// `epsilon` > 0 bounds the divergence of disjoint rays at −ln ε nats (the released code has 1e-10). A pair in which
/// either ray hits nothing (Σα < 1e-20) gives 0 with zero gradient.
///
/// - `tau`, `near`: optical depths, both `[M]`, packed by the same `segments`.
///
/// For the reverse direction of the released code swap the arguments.
///
/// # Panics
/// If the shapes do not match `segments`, or `epsilon` is not positive.
pub fn ray_divergence(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number per packed sample");
    assert_eq!(near.dims(), [segments.samples()], "near holds one number per packed sample");
    assert!(epsilon > 0.0, "epsilon must be positive: it bounds the divergence");
    dispatch! {
        &tau.device();
        host => crate::ray_kernel::apply(host::DivergenceKernel { segments: segments.clone(), epsilon }, (tau, near)),
        cube if segments.samples() > 0 => crate::cube::divergence(tau, near, segments, epsilon),
        plain => plain(tau, near, segments, epsilon),
    }
}

/// [`ray_divergence`] from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::zeros([segments.rays()], &device);
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
    use crate::distribution::Distributions;
    use crate::groups::Group;
    use crate::numeric::Opacity;
    use crate::ray_kernel::RayKernel;
    use crate::{RayDistribution, Segments};

    const ALPHA: RayDistribution = RayDistribution::Alpha;

    #[derive(Debug)]
    pub(super) struct DivergenceKernel {
        pub(super) segments: Segments,
        pub(super) epsilon: f32,
    }

    /// Of τ and τ̃ to one number per pair of rays.
    impl RayKernel<2> for DivergenceKernel {
        fn segments(&self) -> &Segments {
            &self.segments
        }

        fn shape(&self) -> Vec<usize> {
            vec![self.segments.rays()]
        }

        #[inline(always)]
        fn forward<const FMA: bool>(&self, group: Group<'_>, inputs: [&[f32]; 2], out: &mut [f32]) {
            let [tau, near] = [Opacity::of::<FMA>(inputs[0]), Opacity::of::<FMA>(inputs[1])];
            let (p, q) = (Distributions::new(&tau, &group, ALPHA), Distributions::new(&near, &group, ALPHA));
            p.divergences::<FMA>(&q, self.epsilon, out);
        }

        #[inline(always)]
        fn backward<const FMA: bool>(
            &self,
            group: Group<'_>,
            inputs: [&[f32]; 2],
            grad: &[f32],
            gradients: [Option<&mut [f32]>; 2],
        ) {
            let [tau, near] = [Opacity::of::<FMA>(inputs[0]), Opacity::of::<FMA>(inputs[1])];
            let (p, q) = (Distributions::new(&tau, &group, ALPHA), Distributions::new(&near, &group, ALPHA));
            p.divergence_gradients::<FMA>(&q, self.epsilon, grad, gradients);
        }
    }
}
