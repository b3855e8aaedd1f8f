use burn::tensor::{FloatDType, Tensor};

use crate::plain::{Padding, exclusive_sum, working_dtype};
use crate::segments::Segments;
use crate::traffic::upload;

/// Computes [`additive_depth`](super::additive_depth) from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, segments: &Segments) -> Tensor<1> {
    if segments.samples() == 0 {
        return tau;
    }
    let device = tau.device();
    let dtype = working_dtype(&device);
    let tau = Padding::new(segments, &device).apply(tau.cast(dtype));
    let [rays, longest] = tau.dims();
    let left = exclusive_sum(tau.clone()).neg() + 1.0;
    let full = tau.clone().greater_equal(left.clone());
    let behind = left.clone().lower_equal_elem(0.0);
    // Both are masked before the division, as a quotient that is discarded later must not be infinite.
    let share = tau.mask_fill(full.clone(), 0.0) / left.mask_fill(full.clone(), 1.0);
    let depth = share.neg().log1p().neg().mask_fill(full, f32::INFINITY).mask_fill(behind, 0.0);
    let packed =
        segments.ranges().enumerate().flat_map(|(ray, range)| (0..range.len()).map(move |i| ray * longest + i));
    let packed = upload(packed.map(|index| index as i32).collect(), [segments.samples()], &device);
    depth.reshape([rays * longest]).select(0, packed).cast(FloatDType::F32)
}
