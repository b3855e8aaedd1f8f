//! Steps of one length along rays, less those that a grid knows to be empty or hidden, packed by ray.
//!
//! A ray has as many equal steps between its near and far end as keep each at most [`MarchSettings::step`] long. Its samples are in the
//! middle of the steps or, jittered, all shifted alike by the ray's random number. On GPUs one kernel counts the samples of each
//! ray, the host reads the counts and sums them up, and another kernel writes the samples.

use burn::tensor::{Device, Tensor};

use super::{PackedSamples, RaySamples, Streams, pack};
use crate::dispatch::dispatch;

/// Steps along rays, and the depth at which they end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarchSettings {
    /// Maximal length of a step.
    pub step: f32,
    /// Optical depth, by the densities of the grid, behind which there are no more samples.
    pub hidden_depth: f32,
}

/// Rays as a GPU marches along them. No tensor is in a graph.
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
    /// Density of each cell, x fastest, `[n³]`; −1 of an empty one. Nothing is known, and nothing skipped, outside the box.
    pub density: Tensor<1>,
    /// n.
    pub resolution: usize,
    /// Corner of the first cell.
    pub corner: [f32; 3],
    /// Cells per scene unit along each axis.
    pub per_unit: [f32; 3],
}

/// Marches along `count` rays for a field on `device`.
///
/// - `walk` adds the samples of ray `r` to a [`RaySamples`], front to back: the host's body, which knows faster ways through
///   empty space than cell by cell, and warped space.
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
            Some((rays, cells)) => crate::cube::march(&rays, cells.as_ref(), march),
            None => on_host(),
        },
        plain => on_host(),
    }
}
