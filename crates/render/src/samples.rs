use infonerf_ops::Segments;
use infonerf_scene::Ray;
use rayon::prelude::*;

/// Packed samples of a bundle of rays.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Which samples belong to which ray.
    pub segments: Segments,
    /// Distance of each sample along its ray, `[M]`, scene units.
    pub t: Vec<f32>,
    /// Length of the interval that each sample stands for, `[M]`.
    pub delta: Vec<f32>,
    /// World positions, `[M, 3]` row-major.
    pub positions: Vec<f32>,
    /// Direction of each ray, `[R, 3]` row-major.
    pub directions: Vec<f32>,
    /// How many candidates there were before skipping.
    pub candidates: usize,
}

impl Samples {
    /// Packs the samples of each ray: `of(ray index)` gives the kept `(t, delta)` and how many candidates there were.
    pub(crate) fn pack(rays: &[Ray], of: impl Fn(usize) -> (Vec<(f32, f32)>, usize) + Sync) -> Self {
        let kept: Vec<_> = (0..rays.len()).into_par_iter().with_min_len(32).map(&of).collect();
        let segments = Segments::from_counts(kept.iter().map(|(samples, _)| samples.len()));
        let total = segments.samples();
        let (mut t, mut delta, mut positions) =
            (Vec::with_capacity(total), Vec::with_capacity(total), Vec::with_capacity(total * 3));
        for (ray, (samples, _)) in rays.iter().zip(&kept) {
            for &(distance, length) in samples {
                t.push(distance);
                delta.push(length);
                positions.extend(ray.at(distance).to_array());
            }
        }
        let directions = rays.iter().flat_map(|ray| ray.direction.to_array()).collect();
        Self { segments, t, delta, positions, directions, candidates: kept.iter().map(|(_, n)| n).sum() }
    }

    /// The same distances along other rays, one for one.
    pub(crate) fn along(&self, rays: &[Ray]) -> Self {
        let positions = self
            .segments
            .ranges()
            .zip(rays)
            .flat_map(|(range, ray)| self.t[range].iter().flat_map(|&t| ray.at(t).to_array()))
            .collect();
        let directions = rays.iter().flat_map(|ray| ray.direction.to_array()).collect();
        Self { positions, directions, ..self.clone() }
    }
}
