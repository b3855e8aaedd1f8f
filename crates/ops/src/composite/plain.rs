use burn::tensor::{FloatDType, Tensor};

use super::Composite;
use crate::plain::{Padding, alpha, exclusive_sum, working_dtype};
use crate::segments::Segments;

/// Computes [`composite`](super::composite()) from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Composite {
    let (rays, channels) = (segments.rays(), values.dims()[1]);
    let device = tau.device();
    let dtype = working_dtype(&device);
    let longest = segments.longest();
    if longest == 0 {
        return Composite { values: Tensor::zeros([rays, channels], &device), acc: Tensor::zeros([rays], &device) };
    }
    let padding = Padding::new(segments, &device);
    let tau = padding.apply(tau.cast(dtype));
    let opacity = alpha(tau.clone());
    // Σw = 1 − e^(−Σ τ): the gradient of this form is the transmittance of the ray, not a difference of sums.
    let acc = alpha(tau.clone().sum_dim(1));
    let weights = exclusive_sum(tau).neg().exp() * opacity;
    let values = values.cast(dtype).select(0, padding.indices.clone()).reshape([rays, longest, channels]);
    let values = (values * weights.unsqueeze_dim::<3>(2)).sum_dim(1).squeeze_dim::<2>(1);
    Composite { values: values.cast(FloatDType::F32), acc: acc.squeeze_dim::<1>(1).cast(FloatDType::F32) }
}
