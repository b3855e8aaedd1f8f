//! Samples that are placed on the device of the field: the host says which rays have samples, and never sees where.

use std::sync::{Arc, Mutex, PoisonError};

use burn::tensor::{Device, Tensor};
use infonerf_field::{Extent, Points};
use infonerf_ops::drawing::DrawnRays;
use infonerf_ops::random::Stream;
use infonerf_ops::sampling::march::{March, Marched};
use infonerf_ops::sampling::{self, Placement, Streams};
use infonerf_ops::{Segments, upload, upload_together};
use infonerf_scene::Ray;
use infonerf_schedule::Moment;

use crate::sampler::Sampler;
use crate::{Draw, OccupancyGrid, RandomStream, RayBundle, RenderOutput, Samples, TrackedRays};

/// Samples of rays that were `drawn` on a device, which marches along them through the `grid`, of so many candidates. No tensor is
/// in a graph.
pub(crate) fn marched_on_device(
    drawn: &DrawnRays,
    grid: Option<&OccupancyGrid>,
    march: &March,
    candidates: usize,
    device: &Device,
) -> (Samples, Points) {
    let DrawnRays { origins, directions, radii, streams: [streams, _], .. } = drawn;
    let cells = grid.map(|grid| grid.cells_on(&device.clone().inner()));
    let rays = [origins.clone(), directions.clone()];
    let Marched { segments, distance, delta, positions } = sampling::march::march(rays, streams, cells.as_ref(), march);
    let tracked = device.is_autodiff();
    let [distance, delta, radii] =
        [distance, delta, radii.clone()].map(|tensor| if tracked { tensor.autodiff() } else { tensor });
    let [positions, directions] =
        [positions, directions.clone()].map(|tensor| if tracked { tensor.autodiff() } else { tensor });
    let extent = Extent::Cones { t: distance.clone(), delta: delta.clone(), radii };
    let points = Points { positions, directions, segments: segments.clone(), extent };
    (Samples::new(segments, distance, delta, candidates), points)
}

/// A bundle of `R` rays on a device, of which `H` pass what can hold content. No tensor is in a graph.
#[derive(Clone, Debug)]
pub(crate) struct RaysOnDevice {
    rays: TrackedRays,
    /// Radius of each ray's cone at distance 1, `[R]`.
    radii: Tensor<1>,
    /// Coordinates of near and far of each ray with samples, `[H, 2]`, or `[1, 2]` if they are those of all.
    ends: Tensor<2>,
    /// Random numbers of the rays with samples, for the first and the fine pass; none for samples that are evenly spaced.
    streams: Option<[Streams; 2]>,
    /// Samples of the first and the fine pass.
    segments: [Segments; 2],
}

/// Sorted coordinates of the samples of a pass (edges under [`Placement::Interval`]), `[H, N]`.
#[derive(Clone, Debug)]
pub(crate) struct CandidatesOnDevice {
    rays: RaysOnDevice,
    t: Tensor<2>,
    /// 0 for the first pass, 1 for the fine one.
    pass: usize,
}

/// The segments of the last bundle whose rays all had samples: those of the next are often the same, and on the device already.
#[derive(Clone, Debug, Default)]
pub(crate) struct KeptSegments(Arc<Mutex<Option<[Segments; 2]>>>);

impl KeptSegments {
    /// Those of `rays` rays with so many samples each in either pass.
    fn uniform(&self, rays: usize, samples: [usize; 2]) -> [Segments; 2] {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = samples.map(|samples| samples * rays);
        match kept.as_ref().filter(|kept| kept[0].rays() == rays && kept.each_ref().map(Segments::samples) == wanted) {
            Some(kept) => kept.clone(),
            None => kept.insert(samples.map(|samples| Segments::uniform(rays, samples))).clone(),
        }
    }
}

impl CandidatesOnDevice {
    /// The stratified samples of the first pass, or nothing if no ray has any.
    pub(crate) fn stratified(sampler: &Sampler, bundle: RayBundle<'_>, at: Moment, device: &Device) -> Option<Self> {
        let config = sampler.config();
        let count = config.samples.at(at).round() as usize;
        let all = match config.placement {
            Placement::Interval => config.fine_samples,
            Placement::Left | Placement::Mid => count + config.fine_samples,
        };
        let intervals: Vec<Option<(f32, f32)>> = bundle.rays.iter().map(|ray| sampler.interval(ray)).collect();
        let hit = intervals.iter().flatten().count();
        if hit == 0 {
            return None;
        }
        let device = device.clone().inner();
        let rays = match bundle.drawn.filter(|_| hit == intervals.len()) {
            Some(drawn) => {
                let segments = sampler.kept_segments().uniform(hit, [count, all]);
                Self::drawn(drawn, &intervals, segments, !bundle.draws.is_empty(), &device)
            }
            None => {
                let segments = [count, all].map(|samples| {
                    let counts = intervals.iter().map(|interval| if interval.is_some() { samples } else { 0 });
                    Segments::from_counts(counts)
                });
                Self::uploaded(bundle, &intervals, segments, &device)
            }
        };
        let jitter = rays.streams.as_ref().map(|[first, _]| first);
        let t = sampling::stratified(rays.ends.clone(), [hit, count], config.placement, jitter);
        Some(Self { rays, t, pass: 0 })
    }

    /// Rays that are there already, all of which have samples.
    fn drawn(
        drawn: &DrawnRays,
        intervals: &[Option<(f32, f32)>],
        segments: [Segments; 2],
        jittered: bool,
        device: &Device,
    ) -> RaysOnDevice {
        let is_common = intervals.iter().all(|interval| *interval == intervals[0]);
        let distinct = if is_common { &intervals[..1] } else { intervals };
        let ends = distinct.iter().flatten().flat_map(|&(near, far)| [near, far]).collect();
        let DrawnRays { origins, directions, radii, streams, .. } = drawn.clone();
        RaysOnDevice {
            rays: TrackedRays { origins, directions },
            radii,
            ends: upload(ends, [distinct.len(), 2], device),
            streams: jittered.then_some(streams),
            segments,
        }
    }

    fn uploaded(
        bundle: RayBundle<'_>,
        intervals: &[Option<(f32, f32)>],
        segments: [Segments; 2],
        device: &Device,
    ) -> RaysOnDevice {
        let RayBundle { rays, draws, .. } = bundle;
        let streams = |of: fn(&Draw) -> Stream| {
            Streams::bits(draws.iter().zip(intervals).filter(|(_, interval)| interval.is_some()).map(|(d, _)| of(d)))
        };
        let (first, fine) = (
            streams(|(noise, ray)| noise.stream(*ray)),
            streams(|(noise, ray)| noise.child(RandomStream::FineSamples).stream(*ray)),
        );
        let triples = |of: fn(&Ray) -> [f32; 3]| rays.iter().flat_map(of).collect();
        let arrays = [
            triples(|ray| ray.origin.to_array()),
            triples(|ray| ray.direction.to_array()),
            rays.iter().map(|ray| ray.radius).collect(),
            intervals.iter().flatten().flat_map(|&(near, far)| [near, far]).collect(),
            first,
            fine,
        ];
        let [origins, directions, radii, ends, first, fine] = upload_together(arrays, &segments.each_ref(), device);
        let [origins, directions] = [origins, directions].map(|numbers| numbers.reshape([rays.len(), 3]));
        RaysOnDevice {
            rays: TrackedRays { origins, directions },
            radii,
            ends: ends.reshape([-1, 2]),
            streams: (!draws.is_empty()).then(|| [first, fine].map(Streams)),
            segments,
        }
    }

    /// Samples of the fine pass, drawn from the weights of `output`, which is of these.
    pub(crate) fn fine(&self, sampler: &Sampler, output: &RenderOutput) -> Self {
        let config = sampler.config();
        let (t, tau, count) = (self.t.clone(), output.tau.clone().inner(), config.fine_samples);
        let jitter = self.rays.streams.as_ref().map(|[_, fine]| fine);
        let t = match config.placement {
            Placement::Interval => sampling::resample(t, tau, count, jitter),
            Placement::Left | Placement::Mid => sampling::importance(t, tau, count, jitter),
        };
        Self { rays: self.rays.clone(), t, pass: 1 }
    }

    /// The samples, and the points at which a field on `device` is evaluated.
    pub(crate) fn pack(&self, sampler: &Sampler, device: &Device) -> (Samples, Points) {
        let (config, warp) = (sampler.config(), sampler.warp());
        let RaysOnDevice { rays, radii, ends, .. } = &self.rays;
        let segments = self.rays.segments[self.pass].clone();
        let [s, delta] = sampling::intervals(self.t.clone(), ends.clone(), config.placement, config.last_interval);
        let distance = warp.distances(s);
        let per_ray = segments.samples() / self.t.dims()[0];
        let candidates = segments.rays() * per_ray;
        let positions = Samples::new(segments.clone(), distance.clone(), delta.clone(), candidates).tracked(rays, warp);
        let tracked = device.is_autodiff();
        let [distance, delta, radii] =
            [distance, delta, radii.clone()].map(|tensor| if tracked { tensor.autodiff() } else { tensor });
        let [positions, directions] =
            [positions, rays.directions.clone()].map(|tensor| if tracked { tensor.autodiff() } else { tensor });
        let extent = Extent::Cones { t: distance.clone(), delta: delta.clone(), radii };
        let points = Points { positions, directions, segments: segments.clone(), extent };
        (Samples::new(segments, distance, delta, candidates), points)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use infonerf_ops::to_host;
    use infonerf_scene::{Aabb, Range, Scene, Space};

    use super::*;
    use crate::sampler::{Candidates, Skip};
    use crate::{Compositing, LastInterval, Noise, OccupancyConfig, RenderConfig, Space as WarpSpace};

    fn config(placement: Placement, space: WarpSpace) -> RenderConfig {
        RenderConfig {
            samples: 9.0.into(),
            fine_samples: 7,
            placement,
            last_interval: LastInterval::Finite,
            compositing: Compositing::Exponential,
            jitter: true,
            space,
            clip_to_bounds: true,
            early_stop_transmittance: 0.0,
            hidden_depth: 0.0,
            residuals: false,
            occupancy: OccupancyConfig {
                enabled: false,
                resolution: 4,
                warmup: 0,
                every: 1,
                alpha_threshold: 0.01,
                decay: 0.9,
                refine: 1,
                carve: false,
            },
        }
    }

    /// Both passes, of rays of which one misses the scene.
    #[test]
    fn samples_are_where_the_host_places_them() {
        let device = Device::flex();
        let space =
            Space { near: 1.0, far: 4.0, range: Range::Distance { near: 1.0, far: 4.0 }, ..Scene::default().space };
        let scene = Scene { space: Space { bounds: Aabb::cube(Vec3::ZERO, 1.0), ..space }, ..Scene::default() };
        let ray = |y: f32| Ray::new(Vec3::new(0.1, y, 2.5), Vec3::new(0.05, 0.1, -1.0).normalize());
        let rays = [ray(0.0), ray(9.0), ray(-0.3)];
        let draws: Vec<Draw> = (0..3).map(|ray| (Noise::new(0, 0, RandomStream::Samples), 5 * ray)).collect();
        let skip = Skip { grid: None, hidden_depth: f32::INFINITY };
        for placement in [Placement::Left, Placement::Mid, Placement::Interval] {
            for space in [WarpSpace::Box, WarpSpace::Contraction] {
                let sampler = Sampler::new(&config(placement, space), &scene);
                for draws in [draws.as_slice(), &[]] {
                    let at = Moment::START;
                    let bundle = RayBundle { draws, ..RayBundle::from(&rays) };
                    let host = sampler.coarse(bundle, None, at, &device);
                    assert!(matches!(host, Candidates::OnHost(_)));
                    let there = CandidatesOnDevice::stratified(&sampler, bundle, at, &device).unwrap();
                    let mut pairs = vec![(host, Candidates::OnDevice(Box::new(there)))];
                    for pass in 0..2 {
                        let (host, there) = &pairs[pass];
                        let [host_pack, pack] =
                            [host, there].map(|candidates| sampler.pack(&rays, candidates, skip, &device));
                        let (samples, points) = &pack;
                        assert_eq!(samples.segments, host_pack.0.segments);
                        assert_eq!(samples.candidates, host_pack.0.candidates);
                        let near = |a: &[f32], b: &[f32]| {
                            assert_eq!(a.len(), b.len());
                            for (a, b) in a.iter().zip(b) {
                                approx::assert_relative_eq!(*a, *b, epsilon = 1e-5, max_relative = 1e-5);
                            }
                        };
                        near(&to_host(samples.delta.clone()), &to_host(host_pack.0.delta.clone()));
                        near(&to_host(points.positions.clone()), &to_host(host_pack.1.positions.clone()));
                        let beside: Vec<Ray> = rays.iter().map(|&ray| Ray { radius: 0.2, ..ray }).rev().collect();
                        let [along, host_along] = [samples, &host_pack.0]
                            .map(|samples| samples.along((&beside).into(), sampler.warp()).positions);
                        near(&to_host(along), &to_host(host_along));
                        near(samples.t(), host_pack.0.t());
                        if pass == 0 {
                            let tau = (0..samples.segments.samples()).map(|i| (i % 4) as f32 * 0.3);
                            let tau = Tensor::from_floats(tau.collect::<Vec<_>>().as_slice(), &device);
                            let output = output(samples.clone(), tau, &device);
                            pairs.push((sampler.fine(host, &output, draws), sampler.fine(there, &output, draws)));
                        }
                    }
                }
            }
        }
    }

    fn output(samples: Samples, tau: Tensor<1>, device: &Device) -> RenderOutput {
        let request = crate::RenderRequest { color: false, hidden: true };
        RenderOutput { tau, ..RenderOutput::empty(samples, request, [0.0; 3], device) }
    }

    /// Through a grid with holes and behind what hides, along rays of which one misses the scene; behind the last sample there is
    /// nothing.
    #[test]
    fn marching_gives_the_hosts_samples() {
        let device = Device::flex();
        let scene = Scene::default();
        let mut config =
            RenderConfig { samples: 40.0.into(), fine_samples: 0, ..config(Placement::Mid, WarpSpace::Box) };
        config.occupancy.resolution = 8;
        let sampler = Sampler::new(&config, &scene);
        let mut grid = OccupancyGrid::new(&config.occupancy, scene.space.bounds);
        let noise = Noise::new(3, 0, RandomStream::Occupancy);
        let (density, occupied) =
            (0..512).map(|cell| (4.0 * noise.uniform(cell, 0), noise.uniform(cell, 1) < 0.6)).unzip();
        grid.restore(density, occupied, true).unwrap();
        let ray = |x: f32, y: f32| Ray::new(Vec3::new(x, y, 4.0), Vec3::new(-0.05, 0.1, -1.0).normalize());
        let rays = [ray(0.3, -0.2), ray(9.0, 9.0), ray(-0.7, 0.6), ray(0.0, 0.0)];
        let draws: Vec<Draw> = (0..4).map(|ray| (noise, 7 * ray)).collect();
        let rows = |of: fn(&Ray) -> Vec3| {
            let numbers: Vec<f32> = rays.iter().flat_map(|ray| of(ray).to_array()).collect();
            infonerf_ops::from_host(&numbers, 3, &device)
        };
        let streams = Streams::bits(draws.iter().map(|(noise, ray)| noise.stream(*ray)));
        let streams = Streams(Tensor::from_floats(streams.as_slice(), &device));
        let drawn = DrawnRays {
            origins: rows(|ray| ray.origin),
            directions: rows(|ray| ray.direction),
            radii: Tensor::zeros([4], &device),
            colors: Tensor::zeros([4, 3], &device),
            classes: Tensor::zeros([4], &device),
            streams: [streams.clone(), streams],
        };
        for (grid, hidden_depth, draws) in
            [(None, f32::INFINITY, &draws[..]), (Some(&grid), 2.0, &draws), (Some(&grid), 9.0, &[])]
        {
            let (at, skip) = (Moment::START, Skip { grid, hidden_depth });
            let (host, _) = sampler.marched(RayBundle { draws, ..(&rays).into() }, skip, at, &device);
            let samples = host.segments.samples();
            let march = sampler.march(sampler.step_length(at)).unwrap();
            let march = March { jittered: !draws.is_empty(), hidden_depth, capacity: samples + 7, ..march };
            let (there, points) = marched_on_device(&drawn, grid, &march, host.candidates, &device);
            assert!(samples > 8 && there.segments.ranges().eq(host.segments.ranges()), "{samples}");
            assert_eq!(sampler.count(&rays, Skip { grid: None, ..skip }, at) > samples, grid.is_some());
            let positions = to_host(points.positions);
            let tail = positions[3 * samples..].iter().chain(&there.t()[samples..]);
            assert!(tail.chain(&to_host(there.delta.clone())[samples..]).all(|number| *number == 0.0));
            let distances = there.t().iter().zip(host.t());
            distances.for_each(|(there, host)| approx::assert_abs_diff_eq!(there, host, epsilon = 1e-5));
        }
    }

    #[test]
    fn rays_that_all_miss_are_the_hosts() {
        let scene = Scene::default();
        let sampler = Sampler::new(&config(Placement::Left, WarpSpace::Box), &scene);
        let away = Ray::new(Vec3::splat(1e6), Vec3::X);
        let placed = CandidatesOnDevice::stratified(&sampler, (&[away]).into(), Moment::START, &Device::flex());
        assert!(placed.is_none());
    }
}
