//! Samples of many rays as packed tensors.

use burn::tensor::{Device, Tensor};
use rayon::prelude::*;

use crate::segments::Segments;
use crate::traffic::upload_together;

/// Packed samples of a bundle of rays. No tensor is in an autodiff graph, unless the device is one of autodiff.
#[derive(Clone, Debug)]
pub struct PackedSamples {
    /// Samples of each ray.
    pub segments: Segments,
    /// Distance of each sample along its ray, `[M]`.
    pub distance: Tensor<1>,
    /// Length of each sample's interval, `[M]`.
    pub delta: Tensor<1>,
    /// Point at which a field is evaluated, `[M, 3]`.
    pub positions: Tensor<2>,
    /// The distances on the host; `None` if a GPU placed the samples.
    pub on_host: Option<Vec<f32>>,
}

/// Samples of consecutive rays, appended ray by ray.
#[derive(Debug, Default)]
pub struct RaySamples {
    counts: Vec<usize>,
    t: Vec<f32>,
    delta: Vec<f32>,
    positions: Vec<f32>,
}

impl RaySamples {
    /// Adds a sample at distance `t`, with an interval of length `delta`, at which a field is evaluated at `position`.
    pub fn push(&mut self, t: f32, delta: f32, position: [f32; 3]) {
        self.t.push(t);
        self.delta.push(delta);
        self.positions.extend(position);
    }
}

/// Packs the samples of `rays` rays for a field on `device`; `add` appends the samples of one ray, front to back.
pub fn pack(rays: usize, device: &Device, add: impl Fn(usize, &mut RaySamples) + Sync) -> PackedSamples {
    /// Number of rays that one thread packs at a time.
    const CHUNK: usize = 128;
    let part = |chunk: usize| {
        let mut part = RaySamples::default();
        for ray in chunk * CHUNK..rays.min((chunk + 1) * CHUNK) {
            let before = part.t.len();
            add(ray, &mut part);
            part.counts.push(part.t.len() - before);
        }
        part
    };
    let parts: Vec<RaySamples> = (0..rays.div_ceil(CHUNK)).into_par_iter().map(part).collect();
    let join = |pick: fn(&RaySamples) -> &[f32]| parts.iter().map(pick).collect::<Vec<_>>().concat();
    let segments = Segments::from_counts(parts.iter().flat_map(|part| part.counts.iter().copied()));
    let t = join(|part| &part.t);
    let arrays = [join(|part| &part.positions), t.clone(), join(|part| &part.delta)];
    let [positions, distance, delta] = upload_together(arrays, &[&segments], device);
    let positions = positions.reshape([segments.samples(), 3]);
    PackedSamples { segments, distance, delta, positions, on_host: Some(t) }
}
