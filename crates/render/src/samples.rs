use burn::tensor::{Device, Tensor};
use infonerf_field::{Extent, Points};
use infonerf_ops::{Segments, upload_together};
use infonerf_scene::Ray;
use rayon::prelude::*;

use crate::{RayBundle, Warp};

/// Packed samples of a bundle of rays.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Which samples belong to which ray.
    pub segments: Segments,
    /// Distance of each sample along its ray, `[M]`, scene units.
    pub t: Vec<f32>,
    /// The same on the device of the field.
    pub distance: Tensor<1>,
    /// Length of each sample's interval, `[M]`: in scene units, or in warped space in units of [`Warp::coordinate`].
    pub delta: Tensor<1>,
    /// Where the field is evaluated, `[M, 3]`: world positions mapped by the [`Warp`]. In an autodiff graph where a gradient is
    /// to reach the rays.
    pub positions: Tensor<2>,
    /// Direction of each ray, `[R, 3]`.
    pub directions: Tensor<2>,
    /// Radius of each ray's cone at distance 1, `[R]`.
    pub radii: Tensor<1>,
    /// Number of candidates before skipping.
    pub candidates: usize,
}

impl Samples {
    /// Packs the samples of each ray: `of(ray index)` returns the kept `(t, delta)` and the number of candidates.
    pub(crate) fn pack(
        rays: &[Ray],
        warp: &Warp,
        device: &Device,
        of: impl Fn(usize) -> (Vec<(f32, f32)>, usize) + Sync,
    ) -> Self {
        const CHUNK: usize = 128;
        let parts: Vec<Part> = (0..rays.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut part = Part::default();
                for (index, ray) in rays.iter().enumerate().skip(chunk * CHUNK).take(CHUNK) {
                    part.add(ray, warp, of(index));
                }
                part
            })
            .collect();
        let join = |pick: fn(&Part) -> &[f32]| parts.iter().map(pick).collect::<Vec<_>>().concat();
        let segments = Segments::from_counts(parts.iter().flat_map(|part| part.counts.iter().copied()));
        let t = join(|part| &part.t);
        let (positions, delta) = (join(|part| &part.positions), join(|part| &part.delta));
        let [positions, distance, delta, directions, radii] =
            upload_together([positions, t.clone(), delta, directions(rays), radii(rays)], Some(&segments), device);
        Self {
            candidates: parts.iter().map(|part| part.candidates).sum(),
            positions: positions.reshape([t.len(), 3]),
            directions: directions.reshape([rays.len(), 3]),
            segments,
            t,
            distance,
            delta,
            radii,
        }
    }

    /// The same with positions `warp(o + t d)` that are differentiable in the rays of `bundle`, if these are tracked. The
    /// distances t are taken as given.
    pub(crate) fn tracked(self, bundle: RayBundle<'_>, warp: &Warp) -> Self {
        let Some(rays) = bundle.tracked.filter(|_| !self.t.is_empty()) else { return self };
        let [origins, directions] = [&rays.origins, &rays.directions].map(|rows| self.segments.spread(rows.clone()));
        let positions = warp.points(origins + directions * self.distance.clone().unsqueeze_dim(1));
        Self { positions, ..self }
    }

    /// The same distances along other rays.
    pub(crate) fn along(&self, rays: &[Ray], warp: &Warp) -> Self {
        let positions: Vec<f32> = self
            .segments
            .ranges()
            .zip(rays)
            .flat_map(|(range, ray)| self.t[range].iter().flat_map(|&t| warp.point(ray.at(t)).to_array()))
            .collect();
        let arrays = [positions, directions(rays), radii(rays)];
        let [positions, directions, radii] = upload_together(arrays, None, &self.distance.device());
        let positions = positions.reshape([self.t.len(), 3]);
        Self { positions, directions: directions.reshape([rays.len(), 3]), radii, ..self.clone() }
    }

    /// The points at which a field is evaluated.
    pub(crate) fn points(&self) -> Points {
        let (t, delta, radii) = (self.distance.clone(), self.delta.clone(), self.radii.clone());
        Points {
            positions: self.positions.clone(),
            directions: self.directions.clone(),
            segments: self.segments.clone(),
            extent: Extent::Cones { t, delta, radii },
        }
    }
}

fn directions(rays: &[Ray]) -> Vec<f32> {
    rays.iter().flat_map(|ray| ray.direction.to_array()).collect()
}

fn radii(rays: &[Ray]) -> Vec<f32> {
    rays.iter().map(|ray| ray.radius).collect()
}

/// Samples of some of the rays.
#[derive(Default)]
struct Part {
    counts: Vec<usize>,
    t: Vec<f32>,
    delta: Vec<f32>,
    positions: Vec<f32>,
    candidates: usize,
}

impl Part {
    fn add(&mut self, ray: &Ray, warp: &Warp, (samples, candidates): (Vec<(f32, f32)>, usize)) {
        self.counts.push(samples.len());
        self.candidates += candidates;
        for (t, delta) in samples {
            self.t.push(t);
            self.delta.push(delta);
            self.positions.extend(warp.point(ray.at(t)).to_array());
        }
    }
}
