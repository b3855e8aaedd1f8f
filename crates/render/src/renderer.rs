use burn::tensor::Device;
use infonerf_field::{Field, Points};
use infonerf_ops::{CompositeOver, additive_depth, composite_over, is_gpu};
use infonerf_scene::{Backdrop, Ray, Scene};
use infonerf_schedule::Moment;

use crate::sampler::{Candidates, Sampler, Skip};
use crate::{
    Compositing, Draw, Model, OccupancyGrid, Passes, RandomStream, RayBundle, RenderConfig, RenderOutput,
    RenderRequest, Samples, Warp,
};

/// Renders bundles of rays of one scene.
#[derive(Clone, Debug)]
pub struct Renderer {
    sampler: Sampler,
    background: [f32; 3],
    backdrop: Backdrop,
}

/// Bounds the memory of pictures: 256 activations per sample take 64 MiB, half of WebGPU's guaranteed buffer size.
const SAMPLES_AT_ONCE: usize = 1 << 16;

impl Renderer {
    /// A renderer for `scene`'s bounds and background.
    pub fn new(config: &RenderConfig, scene: &Scene) -> Self {
        Self { sampler: Sampler::new(config, scene), background: scene.background, backdrop: scene.backdrop }
    }

    /// Mean length of a sample's interval, which the occupancy threshold refers to.
    pub fn step_length(&self, at: Moment) -> f32 {
        self.sampler.step_length(at)
    }

    /// Number of rays to render at a time without gradients: those of 65,536 samples.
    pub fn rays_at_once(&self, at: Moment) -> usize {
        (SAMPLES_AT_ONCE / self.sampler.most(at).max(1)).max(1)
    }

    /// The same before black.
    pub(crate) fn on_black(&self) -> Self {
        Self { background: [0.0; 3], backdrop: Backdrop::Colour, ..self.clone() }
    }

    pub(crate) fn sampler(&self) -> &Sampler {
        &self.sampler
    }

    pub(crate) fn background(&self) -> [f32; 3] {
        self.background
    }

    pub(crate) fn backdrop(&self) -> Backdrop {
        self.backdrop
    }

    /// The map from the world into the box of fields and occupancy grids.
    pub fn warp(&self) -> &Warp {
        self.sampler.warp()
    }

    /// The background colour. In training with an unknown backdrop it is random per bundle, so that the field learns to be
    /// opaque.
    fn behind(&self, draws: &[Draw]) -> [f32; 3] {
        match (self.backdrop, draws.first()) {
            (Backdrop::Unknown, Some((noise, _))) => {
                let noise = noise.child(RandomStream::Background);
                [0, 1, 2].map(|channel| noise.uniform(0, channel))
            }
            _ => self.background,
        }
    }

    /// Renders `rays`. Fields are evaluated at the moment `at` of the run. Without colour, a coarse pass has no gradient.
    pub fn render<'a, F: Field>(
        &self,
        model: &Model<F>,
        rays: impl Into<RayBundle<'a>>,
        request: RenderRequest,
        occupancy: Option<&OccupancyGrid>,
        at: Moment,
    ) -> Passes {
        let config = self.sampler.config();
        let bundle = rays.into();
        let RayBundle { rays, tracked, draws, .. } = bundle;
        let background = self.behind(draws);
        let hidden_depth = if request.hidden { f32::INFINITY } else { config.hidden_depth() };
        let skip = Skip { grid: occupancy, hidden_depth };
        let draws = if config.jitter { draws } else { &[] };
        let evaluate = |field: &F, (samples, mut points): (Samples, Points)| {
            if let Some(rays) = tracked.filter(|_| !points.is_empty()) {
                points.positions = samples.tracked(rays, self.warp());
            }
            self.evaluate(field, samples, &points, request, background, at)
        };
        if config.marches() {
            let samples = self.sampler.marched(RayBundle { draws, ..bundle }, skip, at, &model.fine.device());
            return Passes { coarse: None, fine: evaluate(&model.fine, samples) };
        }
        let candidates = self.sampler.coarse(RayBundle { draws, ..bundle }, occupancy, at, &model.fine.device());
        let render = |field: &F, candidates: &Candidates| {
            evaluate(field, self.sampler.pack(rays, candidates, skip, &field.device()))
        };
        if !config.is_hierarchical() {
            return Passes { coarse: None, fine: render(&model.fine, &candidates) };
        }
        let coarse_field = model.coarse.as_ref().unwrap_or(&model.fine);
        let coarse = if request.color {
            render(coarse_field, &candidates)
        } else {
            let field = coarse_field.valid();
            let (samples, points) = self.sampler.pack(rays, &candidates, skip, &field.device());
            self.evaluate(&field, samples, &points, request, background, at)
        };
        let fine = self.sampler.fine(&candidates, &coarse, draws);
        Passes { coarse: Some(coarse), fine: render(&model.fine, &fine) }
    }

    /// Whether samples of a field on `device` are placed there, where an `occupancy` grid may skip some: not if it would have to
    /// march through warped space, along cameras' depths, or along more than one of `bundles`, whose samples nobody could tell
    /// apart on the host; nor in a hierarchical run with a grid.
    pub fn places_on(&self, device: &Device, occupancy: Option<&OccupancyGrid>, bundles: usize) -> bool {
        let can = if self.marches() { bundles == 1 && self.sampler.march(0.0).is_some() } else { occupancy.is_none() };
        is_gpu(device) && can
    }

    /// Whether a single pass has steps of one length.
    pub fn marches(&self) -> bool {
        self.sampler.config().marches()
    }

    /// The number of samples that marching along `rays` gives in training.
    pub fn count_samples(&self, rays: &[Ray], occupancy: Option<&OccupancyGrid>, at: Moment) -> usize {
        self.sampler.count(rays, Skip { grid: occupancy, hidden_depth: self.sampler.config().hidden_depth() }, at)
    }

    /// Density of `field` along other `rays` at the distances of `output`: samples are paired one by one.
    pub fn along<'a, F: Field>(
        &self,
        field: &F,
        output: &RenderOutput,
        rays: impl Into<RayBundle<'a>>,
        at: Moment,
    ) -> RenderOutput {
        self.evaluate(
            field,
            output.samples.clone(),
            &output.samples.along(rays.into(), self.sampler.warp()),
            RenderRequest { color: false, hidden: true },
            self.background,
            at,
        )
    }

    fn evaluate<F: Field>(
        &self,
        field: &F,
        samples: Samples,
        points: &Points,
        request: RenderRequest,
        background: [f32; 3],
        at: Moment,
    ) -> RenderOutput {
        let device = field.device();
        if samples.segments.samples() == 0 {
            return RenderOutput::empty(samples, request, background, &device);
        }
        let sampled = field.evaluate(points, request.color, at);
        let tau = sampled.sigma * samples.delta.clone();
        let tau = match self.sampler.config().compositing {
            Compositing::Exponential => tau,
            Compositing::Additive => additive_depth(tau, &samples.segments),
        };
        let distances = samples.distance.clone();
        let CompositeOver { color, depth, acc } =
            composite_over(tau.clone(), sampled.color, distances, background, &samples.segments);
        RenderOutput { samples, tau, color, depth, acc, background }
    }
}
