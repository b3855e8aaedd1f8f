use burn::tensor::{FloatDType, Tensor};

use crate::entropy::MIN_ALPHA_SUM;
use crate::plain::{Padding, alpha, working_dtype};
use crate::segments::Segments;

/// Computes [`ray_divergence`](super::ray_divergence) from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::zeros([segments.rays()], &device);
    }
    let padding = Padding::new(segments, &device);
    let density = |tau: Tensor<1>| {
        let alpha = alpha(padding.apply(tau.cast(working_dtype(&device))));
        let sum = alpha.clone().sum_dim(1);
        let missed = sum.clone().lower_elem(MIN_ALPHA_SUM);
        (alpha / sum.mask_fill(missed.clone(), 1.0), missed)
    };
    let (p, p_missed) = density(tau);
    let (q, q_missed) = density(near);
    // Σ (p − q) = 0 is subtracted term by term. With a = p + ε, b = q + ε and r = (p − q)/b this leaves
    // Σ b [(1 + r) ln(1 + r) − r] − ε Σ ln(a/b), whose first sum has terms of second order where p ≈ q: nothing cancels.
    let b = q.clone() + epsilon;
    let r = (p.clone() - q.clone()) / b.clone();
    let near = r.clone().abs().lower_elem(0.5);
    let ln = ((p.clone() + epsilon) / b.clone()).log().mask_where(near, r.clone().clamp(-0.5, 0.5).log1p());
    let terms = b.clone() * (ln.clone() * (r.clone() + 1.0) - r.clone()) - ln.clone() * epsilon;
    // Gradients of Σ p (ln a − ln b): ln(a/b) + 1 − ε/a in p, and −1 + ε/b − r in q. The constants ±1 cancel, as Σ p and
    // Σ q are fixed; they are left out because the other terms would lose their digits next to them.
    let gradient = p.clone() * (ln - (p + epsilon).recip() * epsilon).detach() + q * (b.recip() * epsilon - r).detach();
    let terms = terms.detach() + (gradient.clone() - gradient.detach());
    terms.sum_dim(1).mask_fill(p_missed, 0.0).mask_fill(q_missed, 0.0).squeeze_dim::<1>(1).cast(FloatDType::F32)
}
