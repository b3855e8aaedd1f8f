use std::sync::{Arc, OnceLock};

use burn::tensor::{Device, Tensor};
use infonerf_field::{Extent, Points};
use infonerf_ops::drawing::DrawnRays;
use infonerf_ops::sampling::points_on_rays;
use infonerf_ops::{Segments, split_rows, to_host, upload_together};
use infonerf_scene::Ray;
use rayon::prelude::*;

use crate::{RayBundle, TrackedRays, Warp};

/// Packed samples of a bundle of rays.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Which samples belong to which ray.
    pub segments: Segments,
    /// Distance of each sample along its ray, `[M]`, scene units.
    pub distance: Tensor<1>,
    /// The same on the host, once somebody asks.
    on_host: Arc<OnceLock<Vec<f32>>>,
    /// Length of each sample's interval, `[M]`: in scene units, or in warped space in units of [`Warp::coordinate`].
    pub delta: Tensor<1>,
    /// Number of candidates before skipping.
    pub candidates: usize,
}

impl Samples {
    /// Samples at `distance`, `[M]`, with intervals of length `delta`, `[M]`, of so many candidates.
    pub fn new(segments: Segments, distance: Tensor<1>, delta: Tensor<1>, candidates: usize) -> Self {
        Self { segments, distance, on_host: Arc::default(), delta, candidates }
    }

    /// Distance of each sample along its ray, `[M]`, scene units. A device that placed them is asked once.
    pub fn t(&self) -> &[f32] {
        self.on_host.get_or_init(|| to_host(self.distance.clone()))
    }

    /// Packs the samples of each ray, with the points at which a field is evaluated: world positions mapped by `warp`.
    /// `of(ray index)` returns the kept `(t, delta)` and the number of candidates.
    pub(crate) fn pack(
        rays: &[Ray],
        warp: &Warp,
        device: &Device,
        of: impl Fn(usize) -> (Vec<(f32, f32)>, usize) + Sync,
    ) -> (Self, Points) {
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
            upload_together([positions, t.clone(), delta, directions(rays), radii(rays)], &[&segments], device);
        let candidates = parts.iter().map(|part| part.candidates).sum();
        let samples = Self { segments, distance, on_host: Arc::new(t.into()), delta, candidates };
        let points = samples.points(positions, directions, radii);
        (samples, points)
    }

    /// Positions `warp(o + t d)` that are differentiable in `rays`, `[M, 3]`. The distances t are taken as given.
    pub(crate) fn tracked(&self, rays: &TrackedRays, warp: &Warp) -> Tensor<2> {
        let TrackedRays { origins, directions } = rays.clone();
        warp.points(points_on_rays(origins, directions, self.distance.clone(), &self.segments))
    }

    /// The points at the same distances along other rays: made where the distances are known.
    pub(crate) fn along(&self, bundle: RayBundle<'_>, warp: &Warp) -> Points {
        let (device, rays) = (self.distance.device(), bundle.rays);
        let Some(t) = self.on_host.get() else {
            if let Some(DrawnRays { origins, directions, radii, .. }) = bundle.drawn {
                let tracked =
                    |rows: &Tensor<2>| if device.is_autodiff() { rows.clone().autodiff() } else { rows.clone() };
                let rays = TrackedRays { origins: tracked(origins), directions: tracked(directions) };
                let directions = rays.directions.clone().flatten(0, 1);
                return self.points(self.tracked(&rays, warp).flatten(0, 1), directions, radii.clone());
            }
            let origins = rays.iter().flat_map(|ray| ray.origin.to_array()).collect();
            let [origins, directions, radii] = upload_together([origins, directions(rays), radii(rays)], &[], &device);
            let rows = |numbers: &Tensor<1>| numbers.clone().reshape([rays.len(), 3]);
            let rays = TrackedRays { origins: rows(&origins), directions: rows(&directions) };
            return self.points(self.tracked(&rays, warp).flatten(0, 1), directions, radii);
        };
        let positions: Vec<f32> = self
            .segments
            .ranges()
            .zip(rays)
            .flat_map(|(range, ray)| t[range].iter().flat_map(|&t| warp.point(ray.at(t)).to_array()))
            .collect();
        let [positions, directions, radii] = upload_together([positions, directions(rays), radii(rays)], &[], &device);
        self.points(positions, directions, radii)
    }

    /// The points of these samples at `positions`, given the direction of each ray, three numbers each, and its cone's radius at
    /// distance 1.
    fn points(&self, positions: Tensor<1>, directions: Tensor<1>, radii: Tensor<1>) -> Points {
        Points {
            positions: positions.reshape([self.segments.samples(), 3]),
            directions: directions.reshape([self.segments.rays(), 3]),
            segments: self.segments.clone(),
            extent: Extent::Cones { t: self.distance.clone(), delta: self.delta.clone(), radii },
        }
    }

    /// Those of the first `counts[0]` rays, of the next `counts[1]`, and so on.
    pub(crate) fn split(&self, counts: &[usize]) -> Vec<Self> {
        let segments = self.segments.split(counts);
        let sizes: Vec<usize> = segments.iter().map(Segments::samples).collect();
        let [distances, deltas] = [&self.distance, &self.delta].map(|numbers| split_rows(numbers.clone(), &sizes));
        let mut known = self.on_host.get().map(Vec::as_slice);
        let parts = segments.into_iter().zip(counts).zip(distances.into_iter().zip(deltas));
        let part = |((segments, count), (distance, delta)): ((Segments, &usize), (Tensor<1>, Tensor<1>))| {
            let own = known.as_mut().and_then(|known| known.split_off(..segments.samples()));
            let on_host = own.map_or_else(OnceLock::new, |own| own.to_vec().into());
            let candidates = self.candidates * count / self.segments.rays();
            Self { on_host: Arc::new(on_host), candidates, segments, distance, delta }
        };
        parts.map(part).collect()
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
