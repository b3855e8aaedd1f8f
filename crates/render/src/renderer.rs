use burn::tensor::{Device, Tensor, TensorData};
use infonerf_field::Field;
use infonerf_ops::{Composite, additive_depth, composite::composite};
use infonerf_scene::{Backdrop, Ray, Scene};
use infonerf_schedule::Moment;

use crate::sampler::Sampler;
use crate::{
    Compositing, Model, Noise, OccupancyGrid, Passes, RenderConfig, RenderOutput, RenderRequest, Samples, Stream, Warp,
};

/// Renders bundles of rays of one scene.
#[derive(Clone, Debug)]
pub struct Renderer {
    sampler: Sampler,
    background: [f32; 3],
    backdrop: Backdrop,
}

/// Bounds the memory of pictures: the outputs of 256 neurons take 64 MiB, half of what WebGPU lets a buffer hold at least.
const SAMPLES_AT_ONCE: usize = 1 << 16;

impl Renderer {
    /// A renderer for `scene`'s bounds and background.
    pub fn new(config: &RenderConfig, scene: &Scene) -> Self {
        Self { sampler: Sampler::new(config, scene), background: scene.background, backdrop: scene.backdrop }
    }

    /// Length of the interval that a sample stands for, on average: what occupancy is judged by.
    pub fn step_length(&self, at: Moment) -> f32 {
        self.sampler.step_length(at)
    }

    /// How many rays to render at a time where no gradient is wanted: those of 65,536 samples.
    pub fn rays_at_once(&self) -> usize {
        (SAMPLES_AT_ONCE / self.sampler.most(Moment::END).max(1)).max(1)
    }

    pub(crate) fn sampler(&self) -> &Sampler {
        &self.sampler
    }

    pub(crate) fn background(&self) -> [f32; 3] {
        self.background
    }

    /// How the scene's space is brought into the box that fields and occupancy grids are made for.
    pub fn warp(&self) -> &Warp {
        self.sampler.warp()
    }

    /// What is behind everything. In training before an unknown backdrop it is another colour for each bundle: a field that
    /// lets it through is wrong nearly always, so that it learns to be opaque.
    fn behind(&self, noise: Option<Noise>) -> [f32; 3] {
        match (self.backdrop, noise) {
            (Backdrop::Unknown, Some(noise)) => {
                let noise = noise.child(Stream::Background);
                [0, 1, 2].map(|channel| noise.uniform(0, channel))
            }
            _ => self.background,
        }
    }

    /// Renders `rays`. With `noise` samples are jittered (training), without it they are even (evaluation).
    ///
    /// Where colour is not asked for, a coarse pass is run without a gradient: it only says where to look. `at` goes to the
    /// fields.
    pub fn render<F: Field>(
        &self,
        model: &Model<F>,
        rays: &[Ray],
        request: RenderRequest,
        noise: Option<Noise>,
        occupancy: Option<&OccupancyGrid>,
        at: Moment,
    ) -> Passes {
        let config = self.sampler.config();
        let background = self.behind(noise);
        let noise = noise.filter(|_| config.jitter);
        if config.marches() {
            let samples = self.sampler.marched(rays, noise, occupancy, at);
            return Passes { coarse: None, fine: self.evaluate(&model.fine, samples, request, background, at) };
        }
        let candidates = self.sampler.coarse(rays, noise, at);
        let samples = self.sampler.pack(rays, &candidates, occupancy);
        if !config.is_hierarchical() {
            return Passes { coarse: None, fine: self.evaluate(&model.fine, samples, request, background, at) };
        }
        let coarse_field = model.coarse.as_ref().unwrap_or(&model.fine);
        let coarse = if request.color {
            self.evaluate(coarse_field, samples, request, background, at)
        } else {
            self.evaluate(&coarse_field.valid(), samples, request, background, at)
        };
        let fine = self.sampler.fine(&candidates, &coarse, noise);
        let samples = self.sampler.pack(rays, &fine, occupancy);
        let fine = self.evaluate(&model.fine, samples, request, background, at);
        Passes { coarse: Some(coarse), fine }
    }

    /// Density of `field` along other `rays` at the distances of `output`, whose samples they are paired with one by one.
    pub fn along<F: Field>(&self, field: &F, output: &RenderOutput, rays: &[Ray], at: Moment) -> RenderOutput {
        self.evaluate(
            field,
            output.samples.along(rays, self.sampler.warp()),
            RenderRequest { color: false },
            self.background,
            at,
        )
    }

    fn evaluate<F: Field>(
        &self,
        field: &F,
        samples: Samples,
        request: RenderRequest,
        background: [f32; 3],
        at: Moment,
    ) -> RenderOutput {
        let device = field.device();
        let rays = samples.segments.rays();
        let count = samples.segments.samples();
        if count == 0 {
            return RenderOutput::empty(samples, request, background, &device);
        }
        let sampled = field.evaluate(samples.points(), request.color, at);
        let tau = sampled.sigma * lengths(&samples.delta, &device);
        let tau = match self.sampler.config().compositing {
            Compositing::Exponential => tau,
            Compositing::Additive => additive_depth(tau, &samples.segments),
        };
        let t = Tensor::<2>::from_data(TensorData::new(samples.t.clone(), [count, 1]), &device);
        let values = match sampled.color {
            Some(color) => Tensor::cat(vec![color, t], 1),
            None => t,
        };
        let Composite { values, acc } = composite(tau.clone(), values, &samples.segments);
        let color = request.color.then(|| {
            let behind = acc.clone().neg() + 1.0;
            let background = Tensor::<1>::from_floats(background, &device).unsqueeze::<2>();
            values.clone().narrow(1, 0, 3) + behind.unsqueeze_dim::<2>(1).mul(background)
        });
        let depth = values.narrow(1, if request.color { 3 } else { 0 }, 1).reshape([rays]);
        RenderOutput { samples, tau, color, depth, acc, background }
    }
}

fn lengths(delta: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(delta.to_vec(), [delta.len()]), device)
}
