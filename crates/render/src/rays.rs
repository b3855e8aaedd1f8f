//! Batches of rays.

use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use infonerf_field::{Extent, Points};
use infonerf_ops::sampling::{Streams, points_on_rays};
use infonerf_ops::{is_gpu, upload, upload_together};
use infonerf_scene::Ray;

use crate::noise::{Noise, RandomStream};
use crate::output::{Samples, with_autodiff_of};
use crate::warp::Warp;

/// Batch of `R` rays for the field on one device, made once by [`Renderer::rays`](crate::Renderer::rays).
///
/// The host keeps the rays that it was given, and places samples along them; a GPU places samples along the tensors.
#[derive(Clone, Debug)]
pub struct RayBatch {
    pub(crate) on_host: Arc<[Ray]>,
    /// Near and far of each ray, coordinates of the [`Warp`]; `None` for a ray that misses the scene.
    pub(crate) ends: Arc<[Option<[f32; 2]>]>,
    /// Origins, `[R, 3]`, scene units; in an autodiff graph if cameras are learned with the field.
    origins: Tensor<2>,
    /// Unit directions, `[R, 3]`; in an autodiff graph if cameras are learned with the field.
    directions: Tensor<2>,
    /// Radius of each ray's cone at distance 1, `[R]`.
    radii: Tensor<1>,
    /// Random numbers of the batch; `None` for samples that are evenly spaced.
    pub(crate) jitter: Option<Noise>,
    pub(crate) is_tracked: bool,
}

impl RayBatch {
    pub(crate) fn new(rays: Vec<Ray>, ends: Vec<Option<[f32; 2]>>, device: &Device) -> Self {
        let device = device.clone().inner();
        let vectors = |of: fn(&Ray) -> [f32; 3]| rays.iter().flat_map(of).collect();
        let arrays = [
            vectors(|ray| ray.origin.to_array()),
            vectors(|ray| ray.direction.to_array()),
            rays.iter().map(|ray| ray.radius).collect(),
        ];
        let [origins, directions, radii] = upload_together(arrays, &[], &device);
        let [origins, directions] = [origins, directions].map(|values| values.reshape([rays.len(), 3]));
        let (on_host, ends) = (rays.into(), ends.into());
        Self { on_host, ends, origins, directions, radii, jitter: None, is_tracked: false }
    }

    /// Returns the batch with samples jittered by `noise`, of which ray `r` uses item `r`. Without it samples are evenly spaced.
    #[must_use]
    pub fn jittered(self, noise: Noise) -> Self {
        Self { jitter: Some(noise), ..self }
    }

    /// Returns the batch with `origins` and `directions`, `[R, 3]`, of the same values in an autodiff graph.
    #[must_use]
    pub fn tracked(self, [origins, directions]: [Tensor<2>; 2]) -> Self {
        Self { origins, directions, is_tracked: true, ..self }
    }

    /// Returns the number of rays `R`.
    pub(crate) fn len(&self) -> usize {
        self.on_host.len()
    }

    pub(crate) fn hits(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.ends.iter().enumerate().filter_map(|(ray, ends)| ends.map(|_| ray))
    }

    /// Returns near and far of the rays that meet the scene, `[H, 2]`, on the device and in no autodiff graph.
    pub(crate) fn ends_of_hits(&self) -> Tensor<2> {
        let ends: Vec<f32> = self.ends.iter().flatten().flatten().copied().collect();
        let hits = ends.len() / 2;
        upload(ends, [hits, 2], &self.radii.device())
    }

    /// Returns the random numbers of `rays` on the device, for the fine pass if `fine`, else for the first pass.
    pub(crate) fn streams(&self, rays: impl Iterator<Item = usize>, fine: bool) -> Option<Streams> {
        let noise = self.jitter?;
        let noise = if fine { noise.child(RandomStream::FineSamples) } else { noise };
        Some(Streams::new(rays.map(|ray| noise.stream(ray)), &self.radii.device()))
    }

    /// Returns the origins and directions in no graph, `[R, 3]` each.
    pub(crate) fn geometry(&self) -> [Tensor<2>; 2] {
        let device = self.radii.device();
        [&self.origins, &self.directions].map(|rows| with_autodiff_of(rows, &device))
    }

    /// Returns the points at which a field on `device` is evaluated for samples at known `positions`, `[M, 3]`. Only
    /// [`Self::points`] keeps gradients with respect to rays.
    pub(crate) fn points_at(&self, positions: Tensor<2>, samples: &Samples, device: &Device) -> Points {
        let [t, delta, radii] = [&samples.distance, &samples.delta, &self.radii].map(|v| with_autodiff_of(v, device));
        let [positions, directions] = [&positions, &self.geometry()[1]].map(|rows| with_autodiff_of(rows, device));
        Points { positions, directions, segments: samples.segments.clone(), extent: Extent::Cones { t, delta, radii } }
    }

    /// Returns `warp(o + t d)` for the distances t of `samples`, which have no gradient, as points for a field on
    /// `device`. Differentiable in rays that are in an autodiff graph.
    pub(crate) fn points(&self, samples: &Samples, warp: &Warp, device: &Device) -> Points {
        if samples.segments.samples() > 0 && (self.is_tracked || is_gpu(device)) {
            let [origins, directions] = [&self.origins, &self.directions].map(|rows| with_autodiff_of(rows, device));
            let t = with_autodiff_of(&samples.distance, device);
            let positions = warp.points(points_on_rays(origins, directions, t, &samples.segments));
            return self.points_at(positions, samples, device);
        }
        // On the host one pass over the samples computes all positions.
        let t = samples.t();
        let rays = samples.segments.ranges().zip(self.on_host.iter());
        let position = |ray: &Ray, t: f32| warp.point(ray.at(t)).to_array();
        let positions = rays.flat_map(|(range, ray)| t[range].iter().flat_map(move |&t| position(ray, t))).collect();
        self.points_at(upload(positions, [samples.segments.samples(), 3], device), samples, device)
    }
}
