mod batch;
mod report;
mod step;

pub use self::batch::StepBatch;

use std::sync::Arc;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::tensor::Device;
use infonerf_field::{Extent, Field, RadianceField};
use infonerf_ops::{is_gpu, to_host};
use infonerf_render::{
    Model, ModelFrame, Noise, OccupancyGrid, RandomStream, Renderer, Residuals, TrainedModel, evaluate_at,
};
use infonerf_scene::{Camera, Scene};
use infonerf_schedule::{Fault, Moment};

use self::report::PendingStep;
use crate::checkpoint::Checkpoint;
use crate::config::{Config, TrainConfig, checks};
use crate::error::TrainError;
use crate::event::Event;
use crate::model::{FieldBuilder, field_bounds, optimizer};
use crate::profile::Profile;
use crate::progress::Progress;
use crate::training_scene::TrainingScene;
use crate::weight_averaging::WeightAverage;

/// Number of steps after which the losses on a GPU are read.
const READ_EVERY: usize = 16;

/// Training of one field on one scene or, if the field is conditioned on images, on many.
pub struct Trainer<F: Field = RadianceField> {
    config: Config,
    scenes: Arc<[TrainingScene]>,
    seed: u64,
    /// Time budget in seconds; `None` if the number of steps decides when training ends.
    budget: Option<f64>,
    device: Device,
    builder: FieldBuilder<F>,
    model: Model<F>,
    weight_average: WeightAverage<F>,
    optimizer: ModuleOptimizer,
    occupancy: Option<OccupancyGrid>,
    progress: Progress,
    pending: Vec<PendingStep>,
    read_every: usize,
    profile: Profile,
}

/// State of a run after a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// More steps are to be taken.
    Running,
    /// All steps are taken, or the budget is spent.
    Finished,
    /// The field went empty and no fresh start is left.
    Collapsed,
}

impl Trainer {
    /// Sets up a run on `scene`. The same arguments give the same values on one CPU; GPUs repeat only random numbers, as
    /// the order of their atomic additions varies.
    ///
    /// `budget` is the time in seconds after which training stops at the latest, in place of `train.iterations` steps.
    ///
    /// # Errors
    /// If a file that `config` names cannot be used, or the config needs what the scene does not have. Numbers are checked where
    /// a config is read ([`Config::from_table`], [`Config::check`]).
    pub fn new(
        config: &Config,
        scene: impl Into<Arc<Scene>>,
        seed: u64,
        budget: Option<f64>,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let scene = scene.into();
        let builder = FieldBuilder::configured(config, &scene);
        Self::with_builder(config, vec![scene], seed, budget, device, builder)
    }

    /// Sets up a run over many `scenes`: in each step the field is given some images of one of them, and learns pixels of
    /// another view of it. A checkpoint of the run can be named by `train.init`.
    ///
    /// # Errors
    /// As [`Self::new`], and if there is no scene, or if the config is one of a single scene.
    pub fn on_scenes(config: &Config, scenes: Vec<Arc<Scene>>, seed: u64, device: &Device) -> Result<Self, TrainError> {
        checks::check_multi_scene(config)?;
        let first = scenes.first().ok_or_else(|| Fault::new("scenes", "at least one", "none"))?;
        let builder = FieldBuilder::configured(config, first);
        Self::with_builder(config, scenes, seed, None, device, builder)
    }
}

impl<F: Field> Trainer<F> {
    /// Sets up a run of a custom field: `build` returns it with its initial weights, given a seed and a device.
    /// `config.field` is ignored.
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
        let device = device.clone().autodiff();
        let scenes: Arc<[TrainingScene]> = scenes
            .into_iter()
            .map(|scene| TrainingScene::new(config, scene, builder.sees_images, &device))
            .collect::<Result<_, _>>()?;
        Self::of_parts(config.clone(), scenes, seed, budget, device, builder)
    }

    /// Returns a run before its first step that differs in its seed alone, and shares the data derived from the scene.
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
            optimizer: optimizer(&config),
            occupancy: occupancy_grid(&config, &scenes[0].scene),
            read_every: if is_gpu(&device) { READ_EVERY } else { 1 },
            config,
            scenes,
            seed,
            budget,
            device,
            builder,
            pending: Vec::new(),
            weight_average: WeightAverage { mean: None, count: 0 },
            progress: Progress::default(),
            profile: Profile::default(),
        })
    }

    /// Resumes from `checkpoint`.
    ///
    /// # Errors
    /// If `checkpoint` is of another config.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainError> {
        self.model = checkpoint.restore_model(self.model.clone())?;
        self.weight_average = checkpoint.restore_average(&self.model.valid())?;
        self.optimizer = checkpoint.restore_optimizer(optimizer(&self.config))?;
        if let Some(grid) = &mut self.occupancy {
            checkpoint.restore_occupancy(grid)?;
        }
        self.progress = checkpoint.progress().clone();
        self.pending.clear();
        Ok(())
    }

    /// Makes a checkpoint, from which the run can resume or another begin, after reporting the steps not reported yet.
    ///
    /// # Errors
    /// If the weights cannot be encoded, or a loss of such a step is not finite.
    pub fn checkpoint(&mut self, report: &mut impl FnMut(Event)) -> Result<Checkpoint, TrainError> {
        self.catch_up(report)?;
        let Self { progress, model, weight_average, optimizer, occupancy, .. } = self;
        Checkpoint::take(progress, model, weight_average, optimizer, occupancy.as_ref())
    }

    /// Returns steps, time and samples so far.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Reads the losses of `steps` steps at once from here on, 1 or more. By default a CPU reads them in each step and a GPU,
    /// which idles while it is waited for, after 16. Losses and steps are the same; a collapse is noticed up to
    /// `steps` − 1 steps later.
    pub fn read_every(&mut self, steps: usize) {
        self.read_every = steps;
    }

    /// Waits for the device at the end of each phase of a step from here on, so that [`Self::profile`] shows what a GPU spends
    /// its time on. Steps get slower, as it idles between phases.
    pub fn synchronize_phases(&mut self) {
        self.profile.waits_for = Some(self.device.clone());
    }

    /// Returns the time spent in each phase.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Returns the scene that the field learns; the first of many.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scenes[0].scene
    }

    /// Returns the model without gradients, to render with: the mean over the end of the run, once there is one.
    pub fn model(&self) -> Model<F> {
        let model = self.weight_average.mean.clone().unwrap_or_else(|| self.model.valid());
        model.conditioned(&self.scenes[0].sources, None)
    }

    /// Returns the renderer of the scene.
    pub fn renderer(&self) -> &Renderer {
        &self.scenes[0].renderer
    }

    /// Returns the model and its occupancy grid, once the grid may be used, as training has them.
    pub fn snapshot(&self) -> TrainedModel<F> {
        let is_used = self.progress.step > self.config.render.occupancy.warmup;
        let occupancy = self.occupancy.as_ref().filter(|_| is_used).cloned();
        TrainedModel { model: self.model(), occupancy, at: self.progress.at, frame: self.frame(), residuals: None }
    }

    /// Returns the learned training cameras, in the model's own frame; the scene's cameras if none are learned.
    pub fn cameras(&self) -> Vec<Camera> {
        let given = self.scene().training_cameras();
        let mean = self.weight_average.mean.as_ref().unwrap_or(&self.model);
        mean.cameras.as_ref().map(|cameras| cameras.apply(&given)).unwrap_or(given)
    }

    /// Returns the map from the scene's frame to that of the learned cameras; `None` if both are the same.
    fn frame(&self) -> Option<ModelFrame> {
        let exact = self.scene().exact_cameras.clone();
        let differ = exact.is_some() || self.model.cameras.is_some();
        let centre = self.scene().space.centre.as_dvec3();
        let given = self.scene().training_cameras();
        differ.then(|| ModelFrame::of(exact.as_ref().unwrap_or(&given), &given, &self.cameras(), centre))
    }

    /// Returns the model from which pictures are rendered: the [snapshot](Self::snapshot), with a finer grid if
    /// `render.occupancy.refine` is above 1, and with the residuals of the training views if `render.residuals` is on. The
    /// grid takes evaluations of the field: keep the result.
    pub fn trained(&self) -> TrainedModel<F> {
        let mut trained = self.snapshot();
        let (factor, at) = (self.config.render.occupancy.refine, trained.at);
        if let Some(grid) = trained.occupancy.as_ref().filter(|_| factor > 1) {
            let noise = Noise::new(self.seed, self.progress.step as u64, RandomStream::RefinedOccupancy);
            let extent = Extent::Ball { variance: grid.cell_variance() / (factor * factor) as f32 };
            let sigma = |points| densities(&trained.model.fine, points, &extent, at);
            trained.occupancy = Some(grid.refined(factor, noise, self.renderer().step_length(at), sigma));
        }
        let residuals = || Arc::new(Residuals::new(self.scene().clone(), self.cameras()));
        trained.residuals = self.config.render.residuals.then(residuals);
        trained
    }

    /// Returns the share of the run that is done, in [0, 1]: without a budget of its steps, else of its time, or of the max number
    /// of steps under a budget where that is more.
    pub fn done(&self) -> f64 {
        let of_steps = |steps: usize| self.progress.step as f64 / steps as f64;
        let TrainConfig { iterations, ensemble, .. } = &self.config.train;
        let share = match self.budget {
            Some(budget) => {
                let limit = ensemble.step_limit(self.scene().train.len());
                (self.progress.seconds / budget).max(limit.map_or(0.0, of_steps))
            }
            None => of_steps(*iterations),
        };
        share.min(1.0)
    }
}

fn occupancy_grid(config: &Config, scene: &Scene) -> Option<OccupancyGrid> {
    let grid = &config.render.occupancy;
    grid.enabled.then(|| OccupancyGrid::new(grid, field_bounds(config, scene)))
}

/// Computes densities at `positions`, three values each, which are on no ray, for the occupancy grid.
pub(super) fn densities<F: Field>(field: &F, positions: Vec<f32>, extent: &Extent, at: Moment) -> Vec<f32> {
    to_host(evaluate_at(field, positions, None, extent.clone(), false, at).sigma)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use crate::testing::knot;

    /// Checks that images are copied for fields that need them alone, and that all members of an ensemble share the copies.
    #[test]
    fn images_are_copied_only_for_fields_that_look_at_them() {
        let scene = Arc::new(knot(4, 8));
        let device = Device::flex();
        let encoder = [
            "field={kind='pixelnerf',encoder={width=4,blocks=[1],weights=''},blocks=2,pool_after=1,width=8,\
             frequencies=2,lowest_frequency=1.5,density='softplus'}",
            "render.occupancy.enabled=false",
        ];
        let cases = [(Preset::Fast, &[][..], false), (Preset::Paper, &[], false), (Preset::Paper, &encoder, true)];
        for (preset, settings, copied) in cases {
            let config = Config::of(preset, settings).unwrap();
            let trainer = Trainer::new(&config, scene.clone(), 0, None, &device).unwrap();
            let copies = &trainer.scenes[0].sources.views;
            assert_eq!(copies.len(), if copied { scene.train.len() } else { 0 }, "{settings:?}");
            assert!(Arc::ptr_eq(&trainer.scenes, &trainer.with_seed(1).unwrap().scenes));
        }
    }
}
