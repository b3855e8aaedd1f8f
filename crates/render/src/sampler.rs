//! Placement of samples along rays: candidate distances, without those that are known to be empty or hidden.

use burn::tensor::{Device, Tensor};
use infonerf_field::Points;
use infonerf_ops::sampling::march::{MarchSettings, MarchedRays, march};
use infonerf_ops::sampling::{Placement, importance, intervals, resample, stratified};
use infonerf_ops::{Segments, to_host, upload};
use infonerf_scene::Ray;
use infonerf_schedule::Moment;
use rayon::prelude::*;

use crate::occupancy::OccupancyGrid;
use crate::output::{Samples, with_autodiff_of};
use crate::rays::RayBatch;
use crate::renderer::Renderer;
use crate::steps::UniformSteps;

/// Knowledge of space by which samples are skipped.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skip<'a> {
    /// Empty space; nothing is skipped without a grid.
    pub(crate) grid: Option<&'a OccupancyGrid>,
    /// Optical depth, computed from the grid's densities, behind which samples are hidden.
    pub(crate) hidden_depth: f32,
}

/// Samples of a pass over the `H` rays of a batch that meet the scene, before any is skipped; in no autodiff graph.
#[derive(Clone, Debug)]
pub(crate) struct Coordinates {
    /// Sorted coordinates of `N` samples of each ray, `[H, N]`, or of their edges, `[H, N + 1]`. They are distances,
    /// unless space is warped ([`Warp::coordinate`](crate::Warp::coordinate)).
    t: Tensor<2>,
    /// Near and far of each ray, coordinates, `[H, 2]`.
    ends: Tensor<2>,
}

/// Samples of a pass, with the points at which a field is evaluated.
pub(crate) struct PlacedSamples {
    pub(crate) samples: Samples,
    pub(crate) points: Points,
    /// Indices of the samples among the `H N` candidates; `None` if all are kept.
    pub(crate) kept: Option<Vec<usize>>,
}

impl Renderer {
    /// Returns the mean length of a sample's interval, which the occupancy threshold refers to.
    pub fn step_length(&self, at: Moment) -> f32 {
        let c = &self.config;
        let samples = c.samples.at(at) as f32;
        let coarse = if c.is_hierarchical() && c.placement == Placement::Interval { 0.0 } else { samples };
        self.longest / (coarse + c.fine_samples as f32)
    }

    pub(crate) fn max_samples(&self, at: Moment) -> usize {
        let samples = self.longest / self.step_length(at);
        // Steps of one length are at most as long as this; other rules round the scheduled number of samples.
        if self.config.marches() { samples.ceil() as usize } else { samples.round() as usize }
    }

    /// Returns a batch of `rays` for a field on `device`.
    pub fn rays(&self, rays: Vec<Ray>, device: &Device) -> RayBatch {
        let ends = rays.par_iter().map(|ray| self.interval(ray)).collect();
        RayBatch::new(rays, ends, device)
    }

    /// Places the samples of a single pass with steps of one length.
    pub(crate) fn place_uniform(&self, rays: &RayBatch, skip: Skip<'_>, at: Moment, device: &Device) -> PlacedSamples {
        let settings = MarchSettings { step: self.step_length(at), hidden_depth: skip.hidden_depth };
        let packed = march(
            rays.len(),
            device,
            settings,
            |index, samples| {
                let (ray, Some(ends)) = (&rays.on_host[index], rays.ends[index]) else { return };
                let shift = rays.jitter.map_or(0.5, |noise| noise.uniform(index, 0));
                let steps = UniformSteps::new(self, ray, ends, (settings.step, shift), skip.grid);
                let steps = steps.map(|step| (step.point, (step.t, step.delta)));
                self.for_each_visible(steps, ray, skip, |point, (t, delta)| samples.push(t, delta, point.to_array()));
            },
            || {
                let [origins, directions] = rays.geometry();
                let device = origins.device();
                let ends = rays.ends.iter().flat_map(|ends| ends.unwrap_or([0.0; 2])).collect();
                let ends = upload(ends, [rays.len(), 2], &device);
                let rays = MarchedRays { origins, directions, ends, jitter: rays.streams(0..rays.len(), false) };
                self.warp.is_identity().then(|| (rays, skip.grid.map(|grid| grid.cells_on(&device))))
            },
        );
        let (samples, positions) = Samples::packed(packed, rays.len() * self.max_samples(at), device);
        let points = if rays.is_tracked {
            rays.points(&samples, &self.warp, device)
        } else {
            rays.points_at(positions, &samples, device)
        };
        PlacedSamples { samples, points, kept: None }
    }

    /// Returns the stratified coordinates of the coarse pass, or the only one. At least one ray meets the scene.
    pub(crate) fn first_coordinates(&self, rays: &RayBatch, at: Moment) -> Coordinates {
        let ends = rays.ends_of_hits();
        let count = self.config.samples.at(at).round() as usize;
        let (size, jitter) = ([ends.dims()[0], count], rays.streams(rays.hits(), false));
        Coordinates { t: stratified(ends.clone(), size, self.config.placement, jitter.as_ref()), ends }
    }

    /// Draws the coordinates of the fine pass from the weights of the coarse one, whose samples have optical depths `tau`,
    /// and merges both unless they are edges. A coarse sample that was skipped has weight 0.
    pub(crate) fn fine_coordinates(
        &self,
        rays: &RayBatch,
        coarse: &Coordinates,
        kept: Option<&[usize]>,
        tau: &Tensor<1>,
    ) -> Coordinates {
        let Coordinates { t, ends } = coarse.clone();
        let spans = self.config.placement == Placement::Interval;
        let tau = match kept {
            None => with_autodiff_of(tau, &t.device()),
            Some(kept) => {
                let [hits, columns] = t.dims();
                let candidates = hits * (columns - usize::from(spans));
                let mut all = vec![0.0; candidates];
                kept.iter().zip(to_host(tau.clone())).for_each(|(&index, tau)| all[index] = tau);
                upload(all, [candidates], &t.device())
            }
        };
        let jitter = rays.streams(rays.hits(), true);
        let draw = if spans { resample } else { importance };
        Coordinates { t: draw(t, tau, self.config.fine_samples, jitter.as_ref()), ends }
    }

    /// Places the samples of a pass for a field on `device`, without those that are skipped.
    pub(crate) fn place(&self, rays: &RayBatch, pass: &Coordinates, skip: Skip<'_>, device: &Device) -> PlacedSamples {
        let Coordinates { t, ends } = pass.clone();
        let [coordinate, delta] = intervals(t, ends, self.config.placement, self.config.last_interval);
        let distance = self.warp.distances(coordinate);
        let hits: Vec<usize> = rays.hits().collect();
        let per_ray = distance.dims()[0] / hits.len();
        let mut counts = vec![0; rays.len()];
        let (distance, delta, kept) = match skip.grid {
            None => {
                hits.iter().for_each(|&ray| counts[ray] = per_ray);
                (distance, delta, None)
            }
            Some(_) => {
                let own = distance.device();
                let [distance, delta] = [distance, delta].map(to_host);
                let of_ray = |(row, &ray): (usize, &usize)| {
                    let mut kept = Vec::new();
                    let samples = (row * per_ray..(row + 1) * per_ray).map(|i| (i, (distance[i], delta[i])));
                    self.for_each_visible(samples, &rays.on_host[ray], skip, |index, _| kept.push(index));
                    kept
                };
                let kept: Vec<Vec<usize>> = hits.par_iter().enumerate().map(of_ray).collect();
                hits.iter().zip(&kept).for_each(|(&ray, kept)| counts[ray] = kept.len());
                let kept = kept.concat();
                let pick = |values: &[f32]| upload(kept.iter().map(|&i| values[i]).collect(), [kept.len()], &own);
                (pick(&distance), pick(&delta), Some(kept))
            }
        };
        let [distance, delta] = [distance, delta].map(|values| with_autodiff_of(&values, device));
        let samples = Samples::new(Segments::from_counts(counts), distance, delta, rays.len() * per_ray);
        let points = rays.points(&samples, &self.warp, device);
        PlacedSamples { samples, points, kept }
    }

    /// Returns near and far of the part of a ray that can hold content, in coordinates.
    pub(crate) fn interval(&self, ray: &Ray) -> Option<[f32; 2]> {
        let within = self.range.along(ray);
        let (mut near, mut far) = match self.warp.horizon() {
            // Content extends behind what the cameras look at, and to its sides.
            Some(horizon) => (within.map_or(self.near, |(near, _)| near), horizon),
            None => within?,
        };
        if let Some(bounds) = self.clip {
            let (enter, leave) = bounds.intersect(ray)?;
            (near, far) = (enter.max(near), leave.min(far));
        }
        (near < far).then(|| [near, far].map(|t| self.warp.coordinate(t)))
    }

    /// Calls `visit` with each sample, an index and `(t, δ)`, that is neither in an empty cell nor behind the hidden
    /// depth. A sample that represents its interval lies in every cell that the interval passes.
    ///
    /// Hidden samples would count in the ray's entropy. Without them it is the entropy of the visible part.
    fn for_each_visible<I>(
        &self,
        samples: impl Iterator<Item = (I, (f32, f32))>,
        ray: &Ray,
        skip: Skip<'_>,
        mut visit: impl FnMut(I, (f32, f32)),
    ) {
        let mut depth = 0.0;
        let spans = self.config.placement == Placement::Interval;
        for (index, (t, delta)) in samples {
            if let Some(grid) = skip.grid {
                let density = match spans {
                    true => grid.density_between(ray, t - 0.5 * delta, t + 0.5 * delta),
                    false => grid.occupied_density(self.warp.point(ray.at(t))),
                };
                let Some(density) = density else { continue };
                if depth >= skip.hidden_depth {
                    break;
                }
                depth += density * delta;
            }
            visit(index, (t, delta));
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use infonerf_ops::upload_rows;
    use infonerf_scene::{Range, Scene, Space};

    use super::*;
    use crate::config::RenderConfig;
    use crate::image::tests::config;
    use crate::noise::{Noise, RandomStream};
    use crate::steps::Step;
    use crate::warp::SpaceChoice;

    const NOTHING: Skip<'_> = Skip { grid: None, hidden_depth: f32::INFINITY };

    fn noise() -> Noise {
        Noise::new(3, 0, RandomStream::Samples)
    }

    /// Three rays, the second of which misses the scene of [`scene`].
    fn rays(renderer: &Renderer) -> RayBatch {
        let ray = |x: f32, y: f32| Ray::new(Vec3::new(x, y, 4.0), Vec3::new(-0.05, 0.1, -1.0).normalize());
        renderer.rays(vec![ray(0.3, -0.2), ray(9.0, 9.0), ray(-0.7, 0.6)], &Device::flex())
    }

    fn scene() -> Scene {
        let space =
            Space { near: 1.0, far: 6.0, range: Range::Distance { near: 1.0, far: 6.0 }, ..Scene::default().space };
        Scene { space, ..Scene::default() }
    }

    fn near(got: &[f32], want: &[f32]) {
        assert_eq!(got.len(), want.len());
        got.iter().zip(want).for_each(|(a, b)| approx::assert_relative_eq!(a, b, epsilon = 1e-5, max_relative = 1e-5));
    }

    /// Checks every rule, with and without a warp, in both passes: a grid without empty cells changes no sample, and
    /// tensors of rays in a graph lead to the positions that the host computes.
    #[test]
    fn host_and_tensors_place_the_same_samples() {
        let device = Device::flex();
        let spaces = [SpaceChoice::Box, SpaceChoice::Contraction];
        for (placement, space) in
            Placement::ALL.into_iter().flat_map(|placement| spaces.map(|space| (placement, space)))
        {
            let config =
                RenderConfig { samples: 9.0.into(), fine_samples: 7, clip_to_bounds: true, space, ..config(placement) };
            let renderer = Renderer::new(&config, &scene());
            // The edges of intervals are drawn anew in the fine pass; other samples are merged with those of the coarse one.
            let samples = if placement == Placement::Interval { 7 } else { 9 + 7 };
            assert_eq!(renderer.max_samples(Moment::START), samples, "{placement:?}");
            let mut grid = OccupancyGrid::new(&config.occupancy, renderer.warp.bounds(&scene()));
            grid.restore(vec![0.5; 8], vec![true; 8], true).unwrap();
            for jitter in [None, Some(noise())] {
                let rays = rays(&renderer);
                let rays = jitter.map_or(rays.clone(), |noise| rays.jittered(noise));
                let tracked = rays.clone().tracked(rays.geometry());
                let mut pass = renderer.first_coordinates(&rays, Moment::START);
                for is_fine in [false, true] {
                    let all = renderer.place(&rays, &pass, NOTHING, &device);
                    let counts: Vec<usize> = all.samples.segments.ranges().map(|range| range.len()).collect();
                    let missed = if space == SpaceChoice::Box { 0 } else { counts[0] };
                    assert!(counts[0] > 0 && counts == [counts[0], missed, counts[0]], "{placement:?} {counts:?}");
                    assert_eq!(all.samples.candidates, 3 * counts[0]);
                    let skip = Skip { grid: Some(&grid), ..NOTHING };
                    let known = renderer.place(&tracked, &pass, skip, &device);
                    assert_eq!(known.kept, Some((0..all.samples.segments.samples()).collect()));
                    near(known.samples.t(), all.samples.t());
                    near(&to_host(known.points.positions), &to_host(all.points.positions));
                    assert!(all.samples.t().windows(2).filter(|t| t[0] > t[1]).count() < 3, "sorted along each ray");
                    if !is_fine {
                        let tau = (0..all.samples.segments.samples()).map(|i| (i % 4) as f32 * 0.3).collect::<Vec<_>>();
                        let tau = Tensor::from_floats(tau.as_slice(), &device);
                        let fine = renderer.fine_coordinates(&rays, &pass, None, &tau);
                        let skipped = renderer.fine_coordinates(&rays, &pass, known.kept.as_deref(), &tau);
                        assert_eq!(to_host(fine.t.clone()), to_host(skipped.t));
                        pass = fine;
                    }
                }
            }
        }
    }

    /// Checks that points keep the gradient with respect to tracked rays.
    #[test]
    fn points_follow_tracked_rays() {
        let renderer = Renderer::new(&config(Placement::Mid), &scene());
        let (device, rays) = (Device::flex().autodiff(), rays(&renderer));
        let tracked = rays.geometry().map(|rows| upload_rows(&to_host(rows), 3, &device).require_grad());
        let pass = renderer.first_coordinates(&rays, Moment::START);
        let placed = renderer.place(&rays.tracked(tracked.clone()), &pass, NOTHING, &device);
        let gradients = placed.points.positions.sum().backward();
        // The derivative of o + t d with respect to o is 1 for each sample of a ray.
        let counts: Vec<f32> = placed.samples.segments.ranges().map(|range| range.len() as f32).collect();
        assert_eq!(to_host(tracked[0].grad(&gradients).unwrap()), [0, 1, 2].map(|ray| [counts[ray]; 3]).concat());
        assert!(to_host(tracked[1].grad(&gradients).unwrap())[0] > 1.0);
    }

    /// Checks that a sample that represents its interval is kept if the interval begins or ends in an occupied cell.
    #[test]
    fn intervals_are_kept_that_pass_an_occupied_cell() {
        let mut config = config(Placement::Interval);
        config.occupancy.resolution = 16;
        let renderer = Renderer::new(&config, &scene());
        let mut grid = OccupancyGrid::new(&config.occupancy, scene().space.bounds);
        // The layer −0.1875 < z < 0.
        grid.restore(vec![1.0; 4096], (0..4096).map(|cell| cell / 256 == 7).collect(), true).unwrap();
        let ray = Ray::new(Vec3::new(0.3, -0.2, 4.0), Vec3::NEG_Z);
        let samples = [3.6, 3.8, 4.3, 4.5].map(|t| (t, (t, 0.6)));
        let mut kept = Vec::new();
        let skip = Skip { grid: Some(&grid), ..NOTHING };
        renderer.for_each_visible(samples.into_iter(), &ray, skip, |t: f32, _| kept.push(t));
        assert_eq!(kept, [3.8, 4.3]);
    }

    /// Checks that a march keeps all steps but those in empty cells and those behind the hidden depth.
    #[test]
    fn march_skips_what_the_grid_knows_to_be_empty_or_hidden() {
        let device = Device::flex();
        for space in [SpaceChoice::Box, SpaceChoice::Contraction] {
            let mut config =
                RenderConfig { samples: 40.3.into(), clip_to_bounds: true, space, ..config(Placement::Mid) };
            config.occupancy.resolution = 8;
            let renderer = Renderer::new(&config, &scene());
            let mut grid = OccupancyGrid::new(&config.occupancy, renderer.warp.bounds(&scene()));
            let (density, occupied) =
                (0..512).map(|cell| (4.0 * noise().uniform(cell, 0), noise().uniform(cell, 1) < 0.6)).unzip();
            grid.restore(density, occupied, true).unwrap();
            let rays = rays(&renderer).jittered(noise());
            let (at, skip) = (Moment::START, Skip { grid: Some(&grid), hidden_depth: 2.0 });
            let marched = renderer.place_uniform(&rays, skip, at, &device).samples;
            let all = renderer.place_uniform(&rays, NOTHING, at, &device).samples;
            let mut want = Vec::new();
            for (index, ray) in rays.on_host.iter().enumerate() {
                let Some(ends) = rays.ends[index] else { continue };
                let places = (renderer.step_length(at), noise().uniform(index, 0));
                let mut depth = 0.0;
                for Step { t, delta, .. } in UniformSteps::new(&renderer, ray, ends, places, None) {
                    let Some(density) = grid.occupied_density(renderer.warp.point(ray.at(t))) else { continue };
                    if depth < skip.hidden_depth {
                        want.push(t);
                    }
                    depth += density * delta;
                }
            }
            assert_eq!(marched.t(), want);
            let (kept, given) = (want.len(), all.segments.samples());
            assert!(kept > 8 && given > kept && given <= all.candidates, "{kept} of {given}");
            assert_eq!((marched.candidates, all.candidates), (123, 123));
        }
    }
}
