//! Where along each ray a field is evaluated: candidate distances, minus what is known to be empty or hidden.

use burn::tensor::Device;
use glam::I64Vec3;
use infonerf_field::Points;
use infonerf_ops::composite::weights;
use infonerf_ops::sampling::distances::{blurred, importance, intervals, resample, stratified};
use infonerf_ops::sampling::march::{March, Reach};
use infonerf_ops::{is_gpu, to_host};
use infonerf_scene::{Aabb, Range, Ray, Scene, Space};
use infonerf_schedule::Moment;
use rayon::prelude::*;

use crate::noise::RandomStream;
use crate::occupancy::{Look, fixed};
use crate::on_device::{CandidatesOnDevice, KeptSegments, marched_on_device};
use crate::{Draw, OccupancyGrid, Placement, RayBundle, RenderConfig, RenderOutput, Samples, Warp};

/// Where the samples of a pass can be, before any is skipped.
#[derive(Clone, Debug)]
pub(crate) enum Candidates {
    /// Of each ray, its samples' sorted coordinates (edges under [`Placement::Interval`]) with the ends of its interval; none if
    /// it misses the bounds. A coordinate is the distance, unless space is warped ([`Warp::coordinate`]).
    OnHost(Vec<Option<OfRay>>),
    /// The same on a GPU, where nothing is skipped.
    OnDevice(Box<CandidatesOnDevice>),
}

/// Coordinates of a ray's samples, and those of its near and far end.
type OfRay = (Vec<f32>, f32, f32);

/// What to skip along rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skip<'a> {
    /// Empty space; without a grid nothing is skipped.
    pub(crate) grid: Option<&'a OccupancyGrid>,
    /// Optical depth, as the grid remembers it, behind which everything is hidden.
    pub(crate) hidden_depth: f32,
}

/// Places samples along the rays of one scene.
#[derive(Clone, Debug)]
pub(crate) struct Sampler {
    config: RenderConfig,
    range: Range,
    near: f32,
    /// Length of the longest ray, in coordinates.
    longest: f32,
    bounds: Aabb,
    warp: Warp,
    kept_segments: KeptSegments,
}

impl Sampler {
    pub(crate) fn new(config: &RenderConfig, scene: &Scene) -> Self {
        let warp = Warp::of(scene, config.space);
        let Space { near, far, range, bounds, .. } = scene.space;
        let longest = if config.clip_to_bounds && warp.is_identity() {
            bounds.size().length()
        } else {
            warp.coordinate(warp.horizon().unwrap_or(far)) - warp.coordinate(near)
        };
        Self { config: config.clone(), range, near, longest, bounds, warp, kept_segments: KeptSegments::default() }
    }

    pub(crate) fn warp(&self) -> &Warp {
        &self.warp
    }

    /// Segments of samples that are placed on a GPU.
    pub(crate) fn kept_segments(&self) -> &KeptSegments {
        &self.kept_segments
    }

    pub(crate) fn config(&self) -> &RenderConfig {
        &self.config
    }

    /// Mean length of a sample's interval, which the occupancy threshold refers to.
    pub(crate) fn step_length(&self, at: Moment) -> f32 {
        let c = &self.config;
        let samples = c.samples.at(at) as f32;
        // Fine samples are merged with the coarse ones, unless they are intervals.
        let coarse = if c.is_hierarchical() && c.placement == Placement::Interval { 0.0 } else { samples };
        self.longest() / (coarse + c.fine_samples as f32)
    }

    /// Number of samples of the longest ray.
    pub(crate) fn most(&self, at: Moment) -> usize {
        (self.longest() / self.step_length(at)).round() as usize
    }

    /// Length of the longest ray, in coordinates.
    pub(crate) fn longest(&self) -> f32 {
        self.longest
    }

    /// Samples of a single pass with steps of one length, in the middle of each step or, jittered, all samples of a ray
    /// shifted alike.
    pub(crate) fn marched(
        &self,
        bundle: RayBundle<'_>,
        skip: Skip<'_>,
        at: Moment,
        device: &Device,
    ) -> (Samples, Points) {
        let RayBundle { rays, drawn, capacity, draws, .. } = bundle;
        let (step, most) = (self.step_length(at), self.most(at));
        if let Some((drawn, march)) = drawn.zip(self.march(step)).filter(|_| is_gpu(device)) {
            let march = March { jittered: !draws.is_empty(), hidden_depth: skip.hidden_depth, capacity, ..march };
            return marched_on_device(drawn, skip.grid, &march, rays.len() * most, device);
        }
        Samples::pack(rays, &self.warp, device, |index| {
            let shift = draws.get(index).map_or(0.5, |(noise, ray)| noise.uniform(*ray, 0));
            (self.kept(&rays[index], step, shift, skip), most)
        })
    }

    /// The number of samples in the middle of their steps.
    pub(crate) fn count(&self, rays: &[Ray], skip: Skip<'_>, at: Moment) -> usize {
        let step = self.step_length(at);
        rays.par_iter().map(|ray| self.kept(ray, step, 0.5, skip).len()).sum()
    }

    /// Steps of one ray that are neither empty nor hidden.
    fn kept(&self, ray: &Ray, step: f32, shift: f32, skip: Skip<'_>) -> Vec<(f32, f32)> {
        let steps = self.steps(ray, step, shift, skip.grid);
        match skip.grid {
            Some(grid) => self.visible(steps, ray, grid, skip.hidden_depth),
            None => steps.collect(),
        }
    }

    /// How a GPU marches with steps of that length; none where only the host can.
    pub(crate) fn march(&self, step: f32) -> Option<March> {
        let reach = match self.range {
            Range::Distance { near, far } => Reach::Distances { near, far },
            Range::Sphere { centre, radius } => Reach::Sphere { centre: centre.to_array(), radius },
            Range::Depth { .. } => return None,
        };
        let corners = [self.bounds.min, self.bounds.max].map(|corner| corner.to_array());
        let bounds = self.clips().then_some(corners);
        let march = March { reach, bounds, step, jittered: false, hidden_depth: f32::INFINITY, capacity: 0 };
        self.warp.is_identity().then_some(march)
    }

    /// The steps of one ray but those in cells that `grid` knows to be empty.
    pub(crate) fn steps<'a>(
        &'a self,
        ray: &'a Ray,
        step: f32,
        shift: f32,
        grid: Option<&'a OccupancyGrid>,
    ) -> Steps<'a> {
        let warp = &self.warp;
        let joined = [Look::of_density(0.0); 2];
        let nothing = Steps { ray, warp, grid, cells: None, near: 0.0, length: step, shift, joined, next: 0, last: 0 };
        let Some((near, far)) = self.interval(ray) else { return nothing };
        let count = ((far - near) / step).ceil().max(1.0);
        let length = (far - near) / count;
        let all = Steps { near, length, last: count as usize, ..nothing };
        let Some(grid) = grid else { return all };
        let cells = warp.is_identity().then(|| {
            let [from, step] = [grid.in_cells(ray.at(near)), grid.cells_along(ray.direction * length)];
            let steps_per_cell = 0.999 / step.abs().max_element();
            CellLine { from: fixed(from + shift * step), step: fixed(step), steps_per_cell }
        });
        if !self.clips() {
            return Steps { cells, ..all };
        }
        // Steps before and behind everything need no look at the grid.
        let Some((enter, leave)) = grid.tight_bounds().intersect(ray) else { return Steps { last: 0, ..all } };
        let index = |t: f32| ((t - near) / length).max(0.0);
        let (first, last) = (index(enter).floor() as usize, index(leave).ceil() as usize + 1);
        Steps { cells, next: first.saturating_sub(1), last: last.min(all.last), ..all }
    }

    /// Stratified distances of each ray, for the coarse pass or the only one: of a field on a GPU without a `grid` placed there.
    pub(crate) fn coarse(
        &self,
        bundle: RayBundle<'_>,
        grid: Option<&OccupancyGrid>,
        at: Moment,
        device: &Device,
    ) -> Candidates {
        if is_gpu(device) && grid.is_none() {
            let placed = CandidatesOnDevice::stratified(self, bundle, at, device);
            if let Some(placed) = placed {
                return Candidates::OnDevice(Box::new(placed));
            }
        }
        let count = self.config.samples.at(at).round() as usize;
        let of_ray = |(index, ray): (usize, &Ray)| {
            let (near, far) = self.interval(ray)?;
            let jitter = bundle.draws.get(index).map(|(noise, ray)| noise.stream(*ray));
            Some((stratified(near, far, count, self.config.placement, jitter), near, far))
        };
        Candidates::OnHost(bundle.rays.iter().enumerate().map(of_ray).collect())
    }

    /// Distances of the fine pass, drawn from the coarse weights. A coarse sample that was skipped has weight 0.
    pub(crate) fn fine(&self, coarse: &Candidates, output: &RenderOutput, draws: &[Draw]) -> Candidates {
        let c = &self.config;
        let coarse = match coarse {
            Candidates::OnHost(coarse) => coarse,
            Candidates::OnDevice(coarse) => return Candidates::OnDevice(Box::new(coarse.fine(self, output))),
        };
        let weights = weights(&to_host(output.tau.clone()), output.segments());
        let distances = output.samples.t();
        let of_ray = |(index, candidates): (usize, &Option<OfRay>)| {
            let (t, near, far) = candidates.as_ref()?;
            let range = output.segments().range(index);
            // Both lists are sorted and the kept distances are copies of candidates.
            let mut kept = distances[range.clone()].iter().zip(&weights[range]).peekable();
            let mut weight = |t: f32| kept.next_if(|(kept, _)| **kept == t).map_or(0.0, |(_, weight)| *weight);
            let dense: Vec<f32> = self.placed(t, *near, *far).map(|(t, _)| weight(t)).collect();
            let jitter = draws.get(index).map(|(noise, ray)| noise.child(RandomStream::FineSamples).stream(*ray));
            let t = match c.placement {
                Placement::Interval => resample(t, &blurred(&dense), c.fine_samples, jitter),
                Placement::Left | Placement::Mid => importance(t, &dense, c.fine_samples, jitter),
            };
            Some((t, *near, *far))
        };
        Candidates::OnHost(coarse.iter().enumerate().map(of_ray).collect())
    }

    /// Candidates with their intervals, less what is skipped.
    pub(crate) fn pack(
        &self,
        rays: &[Ray],
        candidates: &Candidates,
        skip: Skip<'_>,
        device: &Device,
    ) -> (Samples, Points) {
        let candidates = match candidates {
            Candidates::OnHost(candidates) => candidates,
            Candidates::OnDevice(candidates) => return candidates.pack(self, device),
        };
        let samples = |t: &[f32]| t.len() - self.config.placement.numbers(0);
        let longest = candidates.iter().flatten().map(|(t, ..)| samples(t)).max().unwrap_or(0);
        Samples::pack(rays, &self.warp, device, |index| {
            let Some((t, near, far)) = &candidates[index] else { return (Vec::new(), longest) };
            let samples = self.placed(t, *near, *far);
            let candidates = samples.len();
            let kept = match skip.grid {
                Some(grid) => self.visible(samples, &rays[index], grid, skip.hidden_depth),
                None => samples.collect(),
            };
            (kept, candidates)
        })
    }

    /// The samples of one ray from their coordinates: the distance of each, and the length of its interval.
    fn placed(&self, s: &[f32], near: f32, far: f32) -> impl ExactSizeIterator<Item = (f32, f32)> + '_ {
        let samples = intervals(s, near, far, self.config.placement, self.config.last_interval);
        samples.into_iter().map(|(s, length)| (self.warp.distance(s), length))
    }

    /// Whether rays are cut to the scene's box.
    fn clips(&self) -> bool {
        self.config.clip_to_bounds && self.warp.is_identity()
    }

    /// The part of a ray that can hold content, in coordinates.
    pub(crate) fn interval(&self, ray: &Ray) -> Option<(f32, f32)> {
        let within = self.range.along(ray);
        let (mut near, mut far) = match self.warp.horizon() {
            // Content extends behind what the cameras look at, and beside it.
            Some(horizon) => (within.map_or(self.near, |(near, _)| near), horizon),
            None => within?,
        };
        if self.clips() {
            let (enter, leave) = self.bounds.intersect(ray)?;
            (near, far) = (enter.max(near), leave.min(far));
        }
        (near < far).then(|| (self.warp.coordinate(near), self.warp.coordinate(far)))
    }

    /// Drops the samples in empty cells, and those behind the optical depth `hidden_depth`. A sample of
    /// [`Placement::Interval`] lies in every cell that its interval passes.
    ///
    /// A hidden sample would count in the ray's entropy, which is then that of the visible part alone.
    fn visible(
        &self,
        samples: impl Iterator<Item = (f32, f32)>,
        ray: &Ray,
        grid: &OccupancyGrid,
        hidden_depth: f32,
    ) -> Vec<(f32, f32)> {
        let mut depth = 0.0;
        let mut kept = Vec::with_capacity(32);
        for (t, delta) in samples {
            let density = match self.config.placement {
                Placement::Left | Placement::Mid => grid.occupied_density(self.warp.point(ray.at(t))),
                Placement::Interval => grid.density_between(ray, t - 0.5 * delta, t + 0.5 * delta),
            };
            let Some(density) = density else { continue };
            if depth >= hidden_depth {
                break;
            }
            depth += density * delta;
            kept.push((t, delta));
        }
        kept
    }
}

/// `(distance, length)` of samples along a ray, front to back: steps of one length less those in empty cells of a grid, where
/// [`Self::join`] says so two or four as one.
#[derive(Clone, Debug)]
pub(crate) struct Steps<'a> {
    ray: &'a Ray,
    warp: &'a Warp,
    grid: Option<&'a OccupancyGrid>,
    /// Coordinate where the first step begins.
    near: f32,
    /// Length of a step, in coordinates.
    length: f32,
    /// Where in a step its sample is, 0 to 1.
    shift: f32,
    /// The ray among the cells of the grid, unless space is warped.
    cells: Option<CellLine>,
    /// Two steps are one sample where both look less than the first of these, four where all look less than the second.
    joined: [Look; 2],
    next: usize,
    last: usize,
}

/// A ray among a grid's cells, in fixed point.
#[derive(Clone, Copy, Debug)]
struct CellLine {
    /// The first sample.
    from: I64Vec3,
    /// Along one step.
    step: I64Vec3,
    /// Steps in the width of a cell, along the axis on which the ray passes cells fastest; rounded down a little.
    steps_per_cell: f32,
}

impl Steps<'_> {
    /// From here on, makes one sample of two steps that the grid knows to be less deep than `depths[0]` each, and of four below
    /// `depths[1]`, which is less.
    pub(crate) fn join(&mut self, depths: [f32; 2]) {
        self.joined = depths.map(|depth| Look::of_density(depth / self.length));
    }

    /// Distance of a place in units of steps.
    fn distance(&self, at: f32) -> f32 {
        self.warp.distance(self.near + at * self.length)
    }

    /// What is at the sample of a step.
    #[inline]
    fn look(&self, grid: &OccupancyGrid, step: usize) -> Look {
        match self.cells {
            Some(line) => grid.look_at(line.from + step as i64 * line.step),
            None => {
                let t = self.distance(step as f32 + self.shift);
                grid.look(grid.in_cells(self.warp.point(self.ray.at(t))))
            }
        }
    }

    /// The number of steps from the next on, which looks like `first`, that are one sample.
    fn together(&self, grid: &OccupancyGrid, first: Look) -> usize {
        let [two, four] = self.joined;
        let thin = |ahead: usize, most: Look| self.look(grid, self.next + ahead) < most;
        match self.last - self.next {
            4.. if first < four && (1..4).all(|ahead| thin(ahead, four)) => 4,
            2.. if first < two && thin(1, two) => 2,
            _ => 1,
        }
    }
}

impl Iterator for Steps<'_> {
    type Item = (f32, f32);

    fn next(&mut self) -> Option<(f32, f32)> {
        while self.next < self.last {
            let mut count = 1;
            if let Some(grid) = self.grid {
                let look = self.look(grid, self.next);
                if let Some(away) = look.distance().checked_sub(1) {
                    // Steps through wide empty space are passed over many at a time.
                    let pace = self.cells.map_or(0.0, |line| line.steps_per_cell);
                    self.next += 1 + (f32::from(away) * pace) as usize;
                    continue;
                }
                count = self.together(grid, look);
            }
            let at = self.next as f32 + self.shift + 0.5 * (count - 1) as f32;
            self.next += count;
            return Some((self.distance(at), count as f32 * self.length));
        }
        None
    }
}
