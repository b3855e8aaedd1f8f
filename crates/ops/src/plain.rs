//! Functions that bodies of plain tensors share.

#[cfg(feature = "ndarray")]
use burn::backend::DispatchDevice;
use burn::tensor::{Bool, Device, FloatDType, Int, Tensor};

use crate::segments::Segments;
use crate::traffic::upload;

/// Gather from packed samples `[M]` to rays padded with empty samples `[R, longest]`.
pub(crate) struct Padding {
    pub(crate) indices: Tensor<1, Int>,
    empty: Tensor<2, Bool>,
}

impl Padding {
    pub(crate) fn new(segments: &Segments, device: &Device) -> Self {
        let shape @ [rays, longest] = [segments.rays(), segments.longest()];
        let (mut indices, mut empty) = (vec![0; rays * longest], vec![true; rays * longest]);
        for (ray, range) in segments.ranges().enumerate() {
            for (slot, sample) in range.enumerate() {
                indices[ray * longest + slot] = sample as i32;
                empty[ray * longest + slot] = false;
            }
        }
        Self { indices: upload(indices, [rays * longest], device), empty: upload(empty, shape, device) }
    }

    pub(crate) fn apply(&self, packed: Tensor<1>) -> Tensor<2> {
        let [rays, longest] = self.empty.dims();
        packed.select(0, self.indices.clone()).reshape([rays, longest]).mask_fill(self.empty.clone(), 0.0)
    }
}

/// Computes Σ_{j<i} xⱼ along each row by shifting it. Subtracting xᵢ from Σ_{j≤i} xⱼ would lose the sum before a huge xᵢ.
pub(crate) fn exclusive_sum(rows: Tensor<2>) -> Tensor<2> {
    let [_, columns] = rows.dims();
    if columns < 2 {
        return rows.zeros_like();
    }
    let nothing = rows.clone().narrow(1, 0, 1).zeros_like();
    Tensor::cat(vec![nothing, rows.narrow(1, 0, columns - 1)], 1).cumsum(1)
}

/// Returns the float type of plain tensor operations: `f64` on `ndarray`, as sums over a ray would lose digits in `f32`.
pub(crate) fn working_dtype(device: &Device) -> FloatDType {
    match device.clone().inner().as_dispatch() {
        #[cfg(feature = "ndarray")]
        DispatchDevice::NdArray(_) => FloatDType::F64,
        _ => FloatDType::F32,
    }
}

/// Computes α = 1 − e^−τ: by its series below 0.1, where the difference would cancel.
pub(crate) fn alpha<const D: usize>(tau: Tensor<D>) -> Tensor<D> {
    let small = tau.clone().lower_elem(0.1);
    // Both branches are computed, so the series gets clamped inputs.
    let t = tau.clone().clamp(0.0, 0.1);
    // 1 − t/2 + t²/6 − …: nine terms are exact in `f64`.
    let horner =
        (1..=9).rev().fold(t.zeros_like() + 1.0, |sum: Tensor<D>, n| sum * t.clone() / -(n as f64 + 1.0) + 1.0);
    (tau.neg().exp().neg() + 1.0).mask_where(small, horner * t)
}
