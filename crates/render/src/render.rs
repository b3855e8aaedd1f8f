use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_field::{RadianceField, Sources};
use infonerf_ops::{Composite, composite::composite, composite::weights, to_host};
use infonerf_scene::{Aabb, Ray, Scene};

use crate::sampler::{blurred, importance, intervals, resample, stratified};
use crate::{Noise, OccupancyGrid, Placement, RenderConfig, Samples};

/// What is trained: one field, or a coarse one that tells a fine one where to look.
#[derive(Module, Debug)]
pub struct Model {
    /// The field of the coarse pass, where that is not the one of the fine pass.
    pub coarse: Option<RadianceField>,
    /// The field that is rendered.
    pub fine: RadianceField,
}

impl Model {
    /// The model as it answers when its fields look at `sources`: see [`RadianceField::conditioned`].
    pub fn conditioned(&self, sources: &Sources) -> Self {
        Self {
            coarse: self.coarse.as_ref().map(|field| field.conditioned(sources)),
            fine: self.fine.conditioned(sources),
        }
    }
}

/// What a render has to return beside opacity and distance.
#[derive(Clone, Copy, Debug)]
pub struct Want {
    /// Colour; without it only density is evaluated.
    pub color: bool,
    /// Ray entropy, with this ε inside the logarithm.
    pub entropy: Option<f32>,
}

/// One pass of a field over a bundle of rays.
#[derive(Clone, Debug)]
pub struct Level {
    /// Where it was evaluated.
    pub samples: Samples,
    /// Optical depth τ = σδ of each sample, `[M]`.
    pub tau: Tensor<1>,
    /// Colour on the background, `[R, 3]`; none if it was not wanted.
    pub color: Option<Tensor<2>>,
    /// Distance Σ w t along the ray, `[R]`, scene units.
    pub depth: Tensor<1>,
    /// Opacity, entropy and Σα a ray.
    pub composite: Composite,
}

/// Points along rays before and after skipping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Candidates.
    pub total: u64,
    /// Evaluated by a field.
    pub evaluated: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.total += other.total;
        self.evaluated += other.evaluated;
    }
}

impl From<&Samples> for Counts {
    fn from(samples: &Samples) -> Self {
        Self { total: samples.candidates as u64, evaluated: samples.segments.samples() as u64 }
    }
}

/// Renders bundles of rays of one scene.
#[derive(Clone, Debug)]
pub struct Renderer {
    config: RenderConfig,
    near: f32,
    far: f32,
    bounds: Aabb,
    background: [f32; 3],
}

impl Renderer {
    /// A renderer for `scene`'s bounds and background.
    pub fn new(config: &RenderConfig, scene: &Scene) -> Self {
        Self {
            config: config.clone(),
            near: scene.near,
            far: scene.far,
            bounds: scene.bounds,
            background: scene.background,
        }
    }

    /// Length of the interval that a sample stands for, on average: what occupancy is judged by.
    pub fn step_length(&self, progress: f32) -> f32 {
        let c = &self.config;
        if self.is_hierarchical() || c.samples_start == 0 {
            let merged = if self.is_hierarchical() && c.placement == Placement::Interval { 0 } else { c.samples };
            return self.longest() / (merged + c.fine_samples) as f32;
        }
        let (start, end) = (c.samples_start as f32, c.samples as f32);
        self.longest() / (start * (end / start).powf((2.0 * progress).min(1.0)))
    }

    /// Whether there is a coarse pass that tells a fine one where to look.
    pub(crate) fn is_hierarchical(&self) -> bool {
        self.config.fine_samples > 0
    }

    fn longest(&self) -> f32 {
        if self.config.clip_to_bounds { self.bounds.size().length() } else { self.far - self.near }
    }

    /// Renders `rays`. With `noise` samples are jittered (training), without they are even (evaluation).
    ///
    /// Returns the coarse pass, if there is one, and the fine pass. Where colour is not wanted, the coarse pass is run without
    /// a gradient: it only says where to look. `progress` goes to the fields.
    pub fn render(
        &self,
        model: &Model,
        rays: &[Ray],
        want: Want,
        noise: Option<Noise>,
        occupancy: Option<&OccupancyGrid>,
        progress: f32,
    ) -> (Option<Level>, Level) {
        let noise = noise.filter(|_| self.config.jitter);
        if !self.is_hierarchical() {
            let samples = self.samples(rays, noise, occupancy, progress);
            return (None, self.evaluate(&model.fine, samples, want, progress));
        }
        let coarse_field = model.coarse.as_ref().unwrap_or(&model.fine);
        let candidates = self.coarse_candidates(rays, noise);
        let samples = self.pack(rays, &candidates, occupancy);
        let wanted = Want { entropy: None, ..want };
        let level = if want.color {
            self.evaluate(coarse_field, samples, wanted, progress)
        } else {
            self.evaluate(&coarse_field.valid(), samples, wanted, progress)
        };
        let fine = self.fine_candidates(&candidates, &level, noise);
        let samples = self.pack(rays, &fine, occupancy);
        let fine = self.evaluate(&model.fine, samples, want, progress);
        (Some(level), fine)
    }

    /// Optical depth of the fine field along neighbouring `rays` at the distances of `level`, for the information gain.
    pub fn optical_depth_along(&self, field: &RadianceField, level: &Level, rays: &[Ray], progress: f32) -> Tensor<1> {
        let samples = level.samples.along(rays);
        let sampled = field.evaluate(samples.points(), false, progress);
        sampled.sigma * lengths(&samples.delta, &field.device())
    }

    fn evaluate(&self, field: &RadianceField, samples: Samples, want: Want, progress: f32) -> Level {
        let device = field.device();
        let rays = samples.segments.rays();
        let count = samples.segments.samples();
        if count == 0 {
            return self.nothing(samples, want, &device);
        }
        let sampled = field.evaluate(samples.points(), want.color, progress);
        let tau = sampled.sigma * lengths(&samples.delta, &device);
        let t = Tensor::<2>::from_data(TensorData::new(samples.t.clone(), [count, 1]), &device);
        let values = match sampled.color {
            Some(color) => Tensor::cat(vec![color, t], 1),
            None => t,
        };
        let composite = composite(tau.clone(), values, &samples.segments, want.entropy);
        let color = want.color.then(|| {
            let behind = composite.acc.clone().neg() + 1.0;
            let background = Tensor::<1>::from_floats(self.background, &device).unsqueeze::<2>();
            composite.values.clone().narrow(1, 0, 3) + behind.unsqueeze_dim::<2>(1).mul(background)
        });
        let depth = composite.values.clone().narrow(1, if want.color { 3 } else { 0 }, 1).reshape([rays]);
        Level { samples, tau, color, depth, composite }
    }

    /// A bundle of which every sample was skipped.
    fn nothing(&self, samples: Samples, want: Want, device: &Device) -> Level {
        let rays = samples.segments.rays();
        let zeros = Tensor::<1>::zeros([rays], device);
        let background = Tensor::<1>::from_floats(self.background, device).unsqueeze::<2>();
        Level {
            samples,
            tau: Tensor::empty([0], device),
            color: want.color.then(|| background.repeat_dim(0, rays)),
            depth: zeros.clone(),
            composite: Composite {
                values: Tensor::zeros([rays, if want.color { 4 } else { 1 }], device),
                acc: zeros.clone(),
                alpha_sum: zeros.clone(),
                entropy: zeros,
            },
        }
    }

    /// The part of a ray in which there can be something.
    fn interval(&self, ray: &Ray) -> Option<(f32, f32)> {
        if !self.config.clip_to_bounds {
            return Some((self.near, self.far));
        }
        let (enter, leave) = self.bounds.intersect(ray)?;
        let (near, far) = (enter.max(self.near), leave.min(self.far));
        (near < far).then_some((near, far))
    }

    /// Samples of a field without a coarse network: steps of one length through the part of each ray that is in bounds,
    /// each sample in the middle of its step or, jittered, all of a ray's samples shifted alike.
    fn samples(&self, rays: &[Ray], noise: Option<Noise>, occupancy: Option<&OccupancyGrid>, progress: f32) -> Samples {
        let step = self.step_length(progress);
        let most = (self.longest() / step).round() as usize;
        Samples::pack(rays, |index| {
            let shift = noise.map_or(0.5, |noise| noise.uniform(index, 0));
            (self.steps(&rays[index], step, shift, occupancy), most)
        })
    }

    /// `(distance, length)` of the steps of one ray, without those that are empty or behind what the grid holds for opaque.
    pub(crate) fn steps(&self, ray: &Ray, step: f32, shift: f32, occupancy: Option<&OccupancyGrid>) -> Vec<(f32, f32)> {
        let Some((near, far)) = self.interval(ray) else { return Vec::new() };
        let count = ((far - near) / step).ceil().max(1.0);
        let length = (far - near) / count;
        let at = |i: usize| (near + (i as f32 + shift) * length, length);
        let Some(grid) = occupancy else { return (0..count as usize).map(at).collect() };
        // Steps before and behind everything need no look at the grid.
        let (first, last) = if self.config.clip_to_bounds {
            let Some((enter, leave)) = grid.tight_bounds().intersect(ray) else { return Vec::new() };
            let index = |t: f32| ((t - near) / length).max(0.0);
            (index(enter).floor() as usize, (index(leave).ceil() as usize + 1).min(count as usize))
        } else {
            (0, count as usize)
        };
        self.visible((first.saturating_sub(1)..last).map(at), ray, grid)
    }

    /// Longest ray, and length of a step at the end of training.
    pub(crate) fn final_step(&self) -> (f32, f32) {
        (self.longest(), self.step_length(1.0))
    }

    pub(crate) fn min_transmittance(&self) -> f32 {
        self.config.min_transmittance
    }

    pub(crate) fn background(&self) -> [f32; 3] {
        self.background
    }

    fn coarse_candidates(&self, rays: &[Ray], noise: Option<Noise>) -> Vec<Candidates> {
        let c = &self.config;
        rays.iter()
            .enumerate()
            .map(|(index, ray)| {
                let (near, far) = self.interval(ray)?;
                let t = stratified(near, far, c.samples, c.placement, noise.map(|noise| (noise, index)));
                Some((t, near, far))
            })
            .collect()
    }

    /// Distances of the fine pass, drawn from the coarse weights. A coarse sample that was skipped has weight 0.
    fn fine_candidates(&self, coarse: &[Candidates], level: &Level, noise: Option<Noise>) -> Vec<Candidates> {
        let c = &self.config;
        let weights = weights(&to_host(level.tau.clone()), &level.samples.segments);
        let shifted = noise.map(Noise::next);
        coarse
            .iter()
            .enumerate()
            .map(|(index, candidates)| {
                let (t, near, far) = candidates.as_ref()?;
                let range = level.samples.segments.range(index);
                // Both lists are sorted and the kept distances are copies of candidates.
                let mut kept = level.samples.t[range.clone()].iter().zip(&weights[range]).peekable();
                let mut weight = |t: f32| kept.next_if(|(kept, _)| **kept == t).map_or(0.0, |(_, weight)| *weight);
                let samples = intervals(t, *near, *far, c.placement, c.last_interval);
                let dense: Vec<f32> = samples.into_iter().map(|(t, _)| weight(t)).collect();
                let jitter = shifted.map(|noise| (noise, index));
                let t = match c.placement {
                    Placement::Interval => resample(t, &blurred(&dense), c.fine_samples, jitter),
                    Placement::Left | Placement::Mid => importance(t, &dense, c.fine_samples, jitter),
                };
                Some((t, *near, *far))
            })
            .collect()
    }

    fn pack(&self, rays: &[Ray], candidates: &[Candidates], occupancy: Option<&OccupancyGrid>) -> Samples {
        let c = &self.config;
        Samples::pack(rays, |index| {
            let Some((t, near, far)) = &candidates[index] else { return (Vec::new(), c.samples) };
            let samples = intervals(t, *near, *far, c.placement, c.last_interval);
            let candidates = samples.len();
            let kept = match occupancy {
                Some(grid) => self.visible(samples.into_iter(), &rays[index], grid),
                None => samples,
            };
            (kept, candidates)
        })
    }

    /// Drops the samples in empty cells, and those behind what the grid remembers as opaque. A sample that stands for all
    /// of its interval is in every cell that this passes.
    ///
    /// Hidden samples weigh nothing in the image. They would count in the ray's entropy, which is then that of the visible
    /// part alone.
    fn visible(&self, samples: impl Iterator<Item = (f32, f32)>, ray: &Ray, grid: &OccupancyGrid) -> Vec<(f32, f32)> {
        let enough = if self.config.hidden_depth > 0.0 { self.config.hidden_depth } else { f32::INFINITY };
        let mut depth = 0.0;
        let mut kept = Vec::with_capacity(32);
        for (t, delta) in samples {
            let density = match self.config.placement {
                Placement::Left | Placement::Mid => grid.occupied_density(ray.at(t)),
                Placement::Interval => grid.density_between(ray, t - 0.5 * delta, t + 0.5 * delta),
            };
            let Some(density) = density else { continue };
            if depth >= enough {
                break;
            }
            depth += density * delta;
            kept.push((t, delta));
        }
        kept
    }
}

/// Sorted distances (edges under [`Placement::Interval`]) of one ray with the ends of its interval; none if it misses the
/// bounds.
type Candidates = Option<(Vec<f32>, f32, f32)>;

fn lengths(delta: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(delta.to_vec(), [delta.len()]), device)
}
