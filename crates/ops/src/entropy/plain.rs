use burn::tensor::{FloatDType, Int, Tensor};

use super::{MIN_ALPHA_SUM, RayEntropy};
use crate::plain::{Padding, alpha, working_dtype};
use crate::segments::Segments;

/// Computes [`ray_entropy`](super::ray_entropy) from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, segments: &Segments, epsilon: f32) -> RayEntropy {
    let device = tau.device();
    if segments.longest() == 0 {
        let zeros = Tensor::<1>::zeros([segments.rays()], &device);
        return RayEntropy { bits: zeros.clone(), alpha_sum: zeros };
    }
    let alpha = alpha(Padding::new(segments, &device).apply(tau.cast(working_dtype(&device))));
    let alpha_sum = alpha.clone().sum_dim(1).squeeze_dim::<1>(1).cast(FloatDType::F32);
    RayEntropy { bits: bits(alpha, epsilon).cast(FloatDType::F32), alpha_sum }
}

/// Computes −Σ p log₂(p + ε) with p = α/Σα, 0 where Σα is below [`MIN_ALPHA_SUM`]; inputs are masked before the logarithm.
fn bits(alpha: Tensor<2>, epsilon: f32) -> Tensor<1> {
    let sum = alpha.clone().sum_dim(1);
    let missed = sum.clone().lower_elem(MIN_ALPHA_SUM);
    let sum = sum.mask_fill(missed.clone(), 1.0);
    // The largest p is 1 − `others`, the sum of all other p. If it is above ½, its logarithm is computed from `others`.
    let [rays, samples] = alpha.dims();
    let places = Tensor::<1, Int>::arange(0..samples as i64, &alpha.device()).unsqueeze::<2>().expand([rays, samples]);
    let top = places.equal(alpha.clone().detach().argmax(1).expand([rays, samples]));
    let others = alpha.clone().mask_fill(top.clone(), 0.0).sum_dim(1) / sum.clone();
    let p = alpha.clone() / sum.clone();
    let certain = top.bool_and(p.clone().detach().greater_elem(0.5));
    // Both branches are computed, so `others` is clamped to the range in which this one is used.
    let nearly = (others.clamp(0.0, 0.5).neg() + epsilon).log1p().expand([rays, samples]);
    let log = if epsilon > 0.0 {
        (p.clone() + epsilon).log()
    } else {
        // An empty sample counts as the smallest normal `f32`, so that its gradient is finite.
        alpha.clamp_min(f32::MIN_POSITIVE).log() - sum.log()
    };
    let bits = (p * log.mask_where(certain, nearly)).sum_dim(1) * -std::f32::consts::LOG2_E;
    bits.mask_fill(missed, 0.0).squeeze_dim(1)
}
