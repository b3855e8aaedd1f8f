use burn::tensor::{FloatDType, Tensor};

use crate::composite::{MIN_ALPHA_SUM, Padding, plain_alpha, working_dtype};
use crate::segments::Segments;

/// Computes [`ray_divergence`](super::ray_divergence) from plain tensor operations, on any backend.
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
    // Gradients of Σ p (ln a − ln b) in p and q, less what all samples of a ray have in common, as Σ p and Σ q are fixed: 1 in
    // 1 − ε/a and r in r + 1 − ε/b, next to which the rest would lose its digits.
    let gradient = p.clone() * (ln - (p + epsilon).recip() * epsilon).detach() + q * (b.recip() * epsilon - r).detach();
    let terms = terms.detach() + (gradient.clone() - gradient.detach());
    terms.sum_dim(1).mask_fill(p_missed, 0.0).mask_fill(q_missed, 0.0).squeeze_dim::<1>(1).cast(FloatDType::F32)
}
