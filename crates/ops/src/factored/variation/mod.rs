//! Total variation of the planes.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;

use std::sync::Arc;

use burn::tensor::Tensor;

use super::FactoredLayout;
use crate::dispatch::dispatch;

/// Computes the total variation of the planes, Σ_levels (res/64)/(3 res²) Σ over neighbours of squared differences, `[1]`.
///
/// The factor res/64 smooths the finer levels more, which fewer rays reach. Differentiable in `tables`.
///
/// # Panics
/// If `tables` is not of the layout's length.
pub fn plane_variation(tables: Tensor<1>, layout: &Arc<FactoredLayout>) -> Tensor<1> {
    assert_eq!(tables.dims(), [layout.table_len()], "tables hold every plane and line of the layout");
    dispatch! {
        &tables.device();
        host => crate::host::apply(host::VariationKernel(layout.clone()), [1], [tables.into_dispatch()]),
        cube => crate::cube::apply(gpu::GpuVariation(layout.clone()), [tables.into_dispatch()]),
        plain => plain(tables, layout),
    }
}

fn weight(resolution: usize) -> f32 {
    1.0 / (64.0 * 3.0 * resolution as f32)
}

/// Computes [`plane_variation`] by plain tensor operations, on any backend.
pub fn plain(tables: Tensor<1>, layout: &Arc<FactoredLayout>) -> Tensor<1> {
    let mut sum = Tensor::zeros([1], &tables.device());
    for level in &layout.levels {
        let (r, c) = (level.resolution, level.channels);
        let planes: Tensor<4> = tables.clone().narrow(0, level.offset, 3 * level.plane_len()).reshape([3, r, r, c]);
        for axis in [1, 2] {
            let difference = planes.clone().narrow(axis, 1, r - 1) - planes.clone().narrow(axis, 0, r - 1);
            sum = sum + difference.square().sum() * weight(r);
        }
    }
    sum
}
