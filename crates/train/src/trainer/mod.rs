mod forward;
mod numbers;
mod step;

use std::sync::Arc;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::tensor::Device;
use infonerf_field::{Extent, Field, Points, RadianceField};
use infonerf_ops::{to_host, upload};
use infonerf_render::{Frame, Model, Noise, OccupancyGrid, RandomStream, Renderer, Residuals, TrainedModel, Warp};
use infonerf_scene::{Aabb, Camera, Scene};
use infonerf_schedule::{Fault, Moment};

use self::step::Taken;
use crate::checkpoint::State;
use crate::config::checks;
use crate::device_pixels::{DevicePixels, ExpectedSamples};
use crate::error_sampling::PixelErrors;
use crate::model::{FieldBuilder, optimiser};
use crate::training_scene::TrainingScene;
use crate::weight_averaging::WeightAverage;
use crate::{Checkpoint, Config, Event, Profile, Progress, TrainError};

/// The training of one field, of one scene or, for a field that looks at photographs, of many.
pub struct Trainer<F: Field = RadianceField> {
    config: Config,
    scenes: Arc<[TrainingScene]>,
    seed: u64,
    /// Seconds after which to stop, if the clock and not the number of steps decides.
    budget: Option<f64>,
    device: Device,
    builder: FieldBuilder<F>,
    model: Model<F>,
    weight_average: WeightAverage<F>,
    optimiser: ModuleOptimizer,
    occupancy: Option<OccupancyGrid>,
    pixel_errors: PixelErrors,
    /// The training images on a GPU that can draw pixels of them.
    device_pixels: Option<DevicePixels>,
    /// Whether it draws those of this step.
    draws_on_device: bool,
    /// Samples of its rays, where it marches along them.
    marched: Option<ExpectedSamples>,
    progress: Progress,
    /// Steps that were taken and whose losses nobody knows yet.
    unreported: Vec<Taken>,
    read_every: usize,
    profile: Profile,
}

/// Why a run stopped, or that it has not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// There is more to do.
    Running,
    /// All steps are taken, the budget is spent, or the training error has plateaued.
    Finished,
    /// The field went empty and no fresh start is left.
    Collapsed,
}

impl Trainer {
    /// Sets up a run on `scene`. The same arguments give the same numbers on one CPU; GPUs repeat only what is drawn, as their
    /// atomic additions come in any order.
    ///
    /// `budget` is the time in seconds after which to stop, if the clock and not `train.iterations` decides.
    ///
    /// # Errors
    /// If a number in `config` is out of range, a file that it names cannot be used, the field needs what the scene does not
    /// have.
    pub fn new(
        config: &Config,
        scene: impl Into<Arc<Scene>>,
        seed: u64,
        budget: Option<f64>,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let scene = scene.into();
        let builder = FieldBuilder::configured(config, field_bounds(config, &scene), scene.space.body.clone());
        Self::with_builder(config, vec![scene], seed, budget, device, builder)
    }

    /// Sets up a run over many `scenes`: each step shows the field some photographs of one of them, and asks for pixels of
    /// another view of it. Its checkpoint is what `train.init` takes.
    ///
    /// # Errors
    /// As [`Self::new`], and if there is no scene, or if the config is one of a single scene.
    pub fn on_scenes(config: &Config, scenes: Vec<Arc<Scene>>, seed: u64, device: &Device) -> Result<Self, TrainError> {
        checks::of_many(config)?;
        let first = scenes.first().ok_or_else(|| Fault::new("scenes", "at least one", "none"))?;
        let builder = FieldBuilder::configured(config, field_bounds(config, first), first.space.body.clone());
        Self::with_builder(config, scenes, seed, None, device, builder)
    }
}

impl<F: Field> Trainer<F> {
    /// Sets up a run of a field that is not of this workspace: `build` makes it, with its first weights, of a seed and a
    /// device. `config.field` is not looked at.
    ///
    /// # Errors
    /// As [`Trainer::new`].
    pub fn with_field(
        config: &Config,
        scene: impl Into<Arc<Scene>>,
        seed: u64,
        budget: Option<f64>,
        device: &Device,
        build: impl Fn(u64, &Device) -> F + Send + Sync + 'static,
    ) -> Result<Self, TrainError> {
        Self::with_builder(config, vec![scene.into()], seed, budget, device, FieldBuilder::custom(build))
    }

    fn with_builder(
        config: &Config,
        scenes: Vec<Arc<Scene>>,
        seed: u64,
        budget: Option<f64>,
        device: &Device,
        builder: FieldBuilder<F>,
    ) -> Result<Self, TrainError> {
        checks::of_config(config)?;
        let device = device.clone().autodiff();
        let scenes: Arc<[TrainingScene]> = scenes
            .into_iter()
            .map(|scene| TrainingScene::new(config, scene, builder.sees_photographs(), &device))
            .collect::<Result<_, _>>()?;
        Self::of_parts(config.clone(), scenes, seed, budget, device, builder)
    }

    /// A run that differs in its seed alone, before its first step. Both share what training makes of the scene.
    ///
    /// # Errors
    /// If a file of weights that the config names cannot be used.
    pub fn with_seed(&self, seed: u64) -> Result<Self, TrainError> {
        let (config, scenes) = (self.config.clone(), self.scenes.clone());
        Self::of_parts(config, scenes, seed, self.budget, self.device.clone(), self.builder.clone())
    }

    fn of_parts(
        config: Config,
        scenes: Arc<[TrainingScene]>,
        seed: u64,
        budget: Option<f64>,
        device: Device,
        builder: FieldBuilder<F>,
    ) -> Result<Self, TrainError> {
        Ok(Self {
            model: builder.model(&config, &scenes[0].scene, seed, &device)?,
            optimiser: optimiser(&config),
            occupancy: occupancy_grid(&config, &scenes[0].scene),
            read_every: step::read_every(&device),
            config,
            scenes,
            seed,
            budget,
            device,
            builder,
            unreported: Vec::new(),
            weight_average: WeightAverage::default(),
            pixel_errors: PixelErrors::default(),
            device_pixels: None,
            draws_on_device: false,
            marched: None,
            progress: Progress::default(),
            profile: Profile::default(),
        })
    }

    /// Resumes from `checkpoint`.
    ///
    /// # Errors
    /// If it is of another config.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainError> {
        self.model = checkpoint.restore_model(self.model.clone())?;
        self.weight_average = checkpoint.restore_average(&self.model.valid())?;
        self.optimiser = checkpoint.restore_optimiser(optimiser(&self.config))?;
        if let Some(grid) = &mut self.occupancy {
            checkpoint.restore_occupancy(grid)?;
        }
        self.pixel_errors = checkpoint.restore_pixel_errors()?;
        self.progress = checkpoint.progress().clone();
        self.unreported.clear();
        Ok(())
    }

    /// Everything needed to resume the run later, or to initialise another. Steps that are not reported yet are reported first.
    ///
    /// # Errors
    /// If the weights cannot be encoded, or a loss of such a step is not finite.
    pub fn checkpoint(&mut self, report: &mut impl FnMut(Event)) -> Result<Checkpoint, TrainError> {
        self.catch_up(report)?;
        Checkpoint::take(State {
            progress: &self.progress,
            model: &self.model,
            average: &self.weight_average,
            optimiser: &self.optimiser,
            occupancy: self.occupancy.as_ref(),
            pixel_errors: self.config.train.error_sampling.is_on().then_some(&self.pixel_errors),
        })
    }

    /// Steps, time and samples so far.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Whether the field went empty with no fresh start left: there is nothing to see in it.
    pub fn has_collapsed(&self) -> bool {
        self.progress.empty_steps.are_collapse()
    }

    /// Reads the losses of `steps` steps at once from here on, 1 or more: by default each step's on a CPU, and those of 16 on a
    /// GPU, which idles while it is waited for. No number depends on it.
    pub fn read_every(&mut self, steps: usize) {
        self.read_every = steps;
    }

    /// Waits for the device at the end of each phase of a step from here on, so that [`Self::profile`] is of what a GPU spends
    /// its time on. Steps get slower, as it idles between phases.
    pub fn synchronise_phases(&mut self) {
        self.profile.wait_for(self.device.clone());
    }

    /// Where the time went.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// The scene that it learns; the first of many.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scenes[0].scene
    }

    /// The model without gradients, to render with: the mean over the end of the run, once there is one.
    pub fn model(&self) -> Model<F> {
        let model = self.weight_average.mean().cloned().unwrap_or_else(|| self.model.valid());
        model.conditioned(self.scenes[0].photographs.all(), None)
    }

    /// The renderer of the scene.
    pub fn renderer(&self) -> &Renderer {
        &self.scenes[0].renderer
    }

    /// The occupancy grid once it may be used.
    pub fn occupancy(&self) -> Option<&OccupancyGrid> {
        let config = &self.config.render.occupancy;
        self.occupancy.as_ref().filter(|_| config.carve || self.progress.step > config.warmup)
    }

    /// The model and its occupancy grid as training has them.
    pub fn snapshot(&self) -> TrainedModel<F> {
        let occupancy = self.occupancy().cloned();
        TrainedModel { model: self.model(), occupancy, at: self.progress.at, frame: self.frame(), residuals: None }
    }

    /// The training cameras as they are learnt, in the model's own frame; the scene's if they are not.
    pub fn cameras(&self) -> Vec<Camera> {
        let given = self.given_cameras();
        let mean = self.weight_average.mean().unwrap_or(&self.model);
        mean.cameras.as_ref().map_or_else(|| given.clone(), |cameras| cameras.apply(&given))
    }

    /// The training cameras with which training began.
    fn given_cameras(&self) -> Vec<Camera> {
        self.scene().train.iter().map(|view| view.camera.clone()).collect()
    }

    /// From the scene's frame, which is that of test views, to that of the cameras as they are learnt: none if both are one.
    fn frame(&self) -> Option<Frame> {
        let exact = self.scene().exact_cameras.clone();
        let differ = exact.is_some() || self.model.cameras.is_some();
        let centre = self.scene().space.centre.as_dvec3();
        let given = self.given_cameras();
        differ.then(|| Frame::of(exact.as_ref().unwrap_or(&given), &given, &self.cameras(), centre))
    }

    /// What pictures are rendered from: the [snapshot](Self::snapshot), with a finer grid if `render.occupancy.refine` says
    /// so. The field is then asked where it is empty: worth keeping.
    pub fn trained(&self) -> TrainedModel<F> {
        let TrainedModel { model, occupancy, at, frame, .. } = self.snapshot();
        let factor = self.config.render.occupancy.refine;
        let occupancy = occupancy.map(|grid| {
            if factor == 1 {
                return grid;
            }
            let noise = Noise::new(self.seed, self.progress.step as u64, RandomStream::RefinedOccupancy);
            let extent = Extent::Ball { variance: grid.cell_variance() / (factor * factor) as f32 };
            let length = self.renderer().step_length(at);
            grid.refined(factor, noise, length, |points| densities(&model.fine, points, &extent, at))
        });
        TrainedModel { model, occupancy, at, frame, residuals: None }
    }

    /// The same with the residuals of the training views, if `render.residuals` says so.
    pub fn trained_with_residuals(&self) -> TrainedModel<F> {
        let residuals = || Arc::new(Residuals::new(self.scene().clone(), self.cameras()));
        TrainedModel { residuals: self.config.render.residuals.then(residuals), ..self.trained() }
    }

    /// Share of the run that is done, in [0, 1]: of its time if there is a budget, else of its steps.
    pub fn done(&self) -> f64 {
        let share = match self.budget {
            Some(budget) => self.progress.seconds / budget,
            None => self.progress.step as f64 / self.config.train.iterations as f64,
        };
        share.min(1.0)
    }
}

/// The box that a field of `scene` is made for.
fn field_bounds(config: &Config, scene: &Scene) -> Aabb {
    Warp::of(scene, config.render.space).bounds(scene)
}

fn occupancy_grid(config: &Config, scene: &Scene) -> Option<OccupancyGrid> {
    let bounds = field_bounds(config, scene);
    let config = &config.render.occupancy;
    config.enabled.then(|| {
        let mut grid = OccupancyGrid::new(config, bounds);
        if config.carve {
            grid.carve(&scene.train);
        }
        grid
    })
}

/// Densities of points on no ray, for the occupancy grid.
pub(super) fn densities<F: Field>(field: &F, positions: Vec<f32>, extent: &Extent, at: Moment) -> Vec<f32> {
    let count = positions.len() / 3;
    let points = Points::scattered(upload(positions, [count, 3], &field.device()), extent.clone());
    to_host(field.evaluate(&points, false, at).sigma)
}

#[cfg(test)]
mod tests {
    use infonerf_scene::SceneRequest;

    use super::*;
    use crate::Preset;

    /// All members of an ensemble share the copies.
    #[test]
    fn photographs_are_copied_only_where_a_field_looks_at_them() {
        let request = SceneRequest { image_size: Some(8), ..SceneRequest::default() };
        let scene = Arc::new(infonerf_procedural::load("knot", &request).unwrap());
        let device = Device::flex();
        let encoder = [
            "field={kind='pixelnerf',encoder={width=4,blocks=[1],weights=''},blocks=2,pool_after=1,width=8,\
             frequencies=2,lowest_frequency=1.5,density='softplus'}",
            "render.occupancy.enabled=false",
        ];
        for (preset, settings, copied) in
            [(Preset::Fast, &[][..], false), (Preset::Paper, &[], false), (Preset::Paper, &encoder, true)]
        {
            let config = Config::of(preset, settings).unwrap();
            let trainer = Trainer::new(&config, scene.clone(), 0, None, &device).unwrap();
            let copies = &trainer.scenes[0].photographs.all().views;
            assert_eq!(copies.len(), if copied { scene.train.len() } else { 0 }, "{settings:?}");
            assert!(Arc::ptr_eq(&trainer.scenes, &trainer.with_seed(1).unwrap().scenes));
        }
    }
}
