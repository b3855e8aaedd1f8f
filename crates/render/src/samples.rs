use burn::tensor::Tensor;
use infonerf_field::{Extent, Points};
use infonerf_ops::{Segments, upload};
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
    /// Length of each sample's interval, `[M]`: in scene units, or in warped space in units of [`Warp::coordinate`].
    pub delta: Vec<f32>,
    /// Where the field is evaluated, `[M, 3]` row-major: world positions mapped by the [`Warp`].
    pub positions: Vec<f32>,
    /// Direction of each ray, `[R, 3]` row-major.
    pub directions: Vec<f32>,
    /// Radius of each ray's cone at distance 1, `[R]`.
    pub radii: Vec<f32>,
    /// Number of candidates before skipping.
    pub candidates: usize,
    /// `positions` in an autodiff graph, `[M, 3]`, where a gradient is to reach the rays.
    pub tracked: Option<Tensor<2>>,
}

impl Samples {
    /// Packs the samples of each ray: `of(ray index)` returns the kept `(t, delta)` and the number of candidates.
    pub(crate) fn pack(rays: &[Ray], warp: &Warp, of: impl Fn(usize) -> (Vec<(f32, f32)>, usize) + Sync) -> Self {
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
        let join = |pick: fn(&Part) -> &Vec<f32>| parts.iter().flat_map(|part| pick(part).iter().copied()).collect();
        Self {
            segments: Segments::from_counts(parts.iter().flat_map(|part| part.counts.iter().copied())),
            t: join(|part| &part.t),
            delta: join(|part| &part.delta),
            positions: join(|part| &part.positions),
            directions: rays.iter().flat_map(|ray| ray.direction.to_array()).collect(),
            radii: rays.iter().map(|ray| ray.radius).collect(),
            candidates: parts.iter().map(|part| part.candidates).sum(),
            tracked: None,
        }
    }

    /// The same with positions `warp(o + t d)` that are differentiable in the rays of `bundle`, if these are tracked. The
    /// distances t are taken as given.
    pub(crate) fn tracked(self, bundle: RayBundle<'_>, warp: &Warp) -> Self {
        let Some(rays) = bundle.tracked.filter(|_| !self.t.is_empty()) else { return self };
        let device = rays.origins.device();
        let samples = self.t.len();
        let owners = upload(self.segments.owners(), [samples], &device);
        let t = upload(self.t.clone(), [samples, 1], &device);
        let [origins, directions] =
            [&rays.origins, &rays.directions].map(|rows| rows.clone().select(0, owners.clone()));
        Self { tracked: Some(warp.points(origins + directions * t)), ..self }
    }

    /// The same distances along other rays.
    pub(crate) fn along(&self, rays: &[Ray], warp: &Warp) -> Self {
        let positions = self
            .segments
            .ranges()
            .zip(rays)
            .flat_map(|(range, ray)| self.t[range].iter().flat_map(|&t| warp.point(ray.at(t)).to_array()))
            .collect();
        let directions = rays.iter().flat_map(|ray| ray.direction.to_array()).collect();
        let radii = rays.iter().map(|ray| ray.radius).collect();
        Self { positions, directions, radii, tracked: None, ..self.clone() }
    }

    /// The points at which a field is evaluated.
    pub(crate) fn points(&self) -> Points<'_> {
        Points {
            positions: &self.positions,
            directions: &self.directions,
            segments: &self.segments,
            extent: Extent::Cones { t: &self.t, delta: &self.delta, radii: &self.radii },
            tracked: self.tracked.as_ref(),
        }
    }
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
