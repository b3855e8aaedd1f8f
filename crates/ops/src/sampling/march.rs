//! Equal steps along rays, without those that a grid marks as empty or hidden, packed by ray.
//!
//! A ray is divided between near and far into the fewest equal steps that are at most [`MarchSettings::step`] long.
//! Samples are in the middle of the steps or, jittered, all shifted alike by the ray's random number. On GPUs one kernel
//! counts the samples of each ray, the host reads the counts and sums them up, and another kernel writes the samples.

use burn::tensor::{Device, Tensor};

use super::{PackedSamples, RaySamples, Streams, pack};
use crate::dispatch::dispatch;

/// Steps along rays, and the depth at which they end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarchSettings {
    /// Maximal length of a step, in the unit of near and far.
    pub step: f32,
    /// Optical depth, computed from the grid's densities, behind which there are no more samples.
    pub hidden_depth: f32,
}

/// Rays for marching on a GPU. No tensor is in an autodiff graph.
#[derive(Clone, Debug)]
pub struct MarchedRays {
    /// Origins, `[R, 3]`.
    pub origins: Tensor<2>,
    /// Unit directions, `[R, 3]`.
    pub directions: Tensor<2>,
    /// Near and far, `[R, 2]`; a ray that misses has near ≥ far.
    pub ends: Tensor<2>,
    /// Random numbers that shift the samples of each ray; `None` for samples in the middle of their steps.
    pub jitter: Option<Streams>,
}

/// Densities of the cells of a box, on a GPU.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Density of each cell in 1/scene unit, x fastest, `[n³]`; −1 marks an empty cell. No sample outside the box is skipped.
    pub density: Tensor<1>,
    /// Number n of cells along each axis.
    pub resolution: usize,
    /// Corner of the first cell.
    pub corner: [f32; 3],
    /// Cells per scene unit along each axis.
    pub per_unit: [f32; 3],
}

/// Marches along `count` rays for a field on `device`.
///
/// - `walk` adds the samples of ray `r` to a [`RaySamples`], front to back. This body of the host skips empty space
///   faster than cell by cell, and serves warped space.
/// - `on_gpu` returns the rays and the cells for GPUs; `None` where space is warped, in which the host marches for them.
#[cfg_attr(not(feature = "cube"), allow(unused_variables, reason = "only GPUs march by kernels"))]
pub fn march(
    count: usize,
    device: &Device,
    march: MarchSettings,
    walk: impl Fn(usize, &mut RaySamples) + Sync,
    on_gpu: impl FnOnce() -> Option<(MarchedRays, Option<Cells>)>,
) -> PackedSamples {
    let on_host = || pack(count, device, &walk);
    dispatch! {
        device;
        cube if count > 0 => match on_gpu() {
            Some((rays, cells)) => super::gpu::march(&rays, cells.as_ref(), march),
            None => on_host(),
        },
        plain => on_host(),
    }
}
