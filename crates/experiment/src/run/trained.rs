use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use infonerf_render::{Renderer, TrainedModel};
use infonerf_scene::Scene;
use infonerf_schedule::Schedule;
use infonerf_train::{Progress, Trainer, without_collapsed};

use super::load_checkpoint;
use crate::device::OpenDevice;
use crate::run_plan::RunPlan;

/// A finished or interrupted run with its fields, each restored from its newest checkpoint.
pub struct Trained {
    /// The run.
    pub plan: RunPlan,
    /// Trainers of the fields that pictures are rendered from, one per field.
    pub trainers: Vec<Trainer>,
    /// Models that pictures are rendered from: the fields, with the residuals of the training views if `render.residuals` is set.
    /// A model keeps the residuals that a picture needed.
    pub models: Vec<TrainedModel>,
    /// Warnings: why newer checkpoints were refused, which fields are left out, and whether training has come to its end.
    pub warnings: Vec<String>,
}

impl Trained {
    pub(crate) fn new(plan: RunPlan, trainers: Vec<Trainer>, warnings: Vec<String>) -> Self {
        let models = trainers.iter().map(Trainer::trained).collect();
        Self { plan, trainers, models, warnings }
    }

    /// Reads the run in `folder` with the config of `plan`, which may differ from the run's own.
    ///
    /// # Errors
    /// If it has no checkpoint, or its scene cannot be read.
    pub fn read(plan: RunPlan, folder: &Path, device: &OpenDevice) -> Result<Self> {
        let scene = plan.load().with_context(|| format!("{}/config.toml", folder.display()))?;
        let scene = Arc::new(scene);
        let mut trained = Self::on_scene(plan, scene, folder, device)?;
        let is_under_way = |trainer: &&Trainer| trainer.done() < 1.0 && !trainer.progress().has_collapsed();
        if let Some(least) = trained.trainers.iter().filter(is_under_way).map(Trainer::done).reduce(f64::min) {
            let (folder, percent) = (folder.display(), 100.0 * least);
            trained.warnings.push(format!("{folder}: the run is unfinished: {percent:.1} % of its training is done"));
        }
        Ok(trained)
    }

    /// Reads the run in `folder` with the plan's scene already loaded, such as while the run is being trained.
    ///
    /// # Errors
    /// If it has no checkpoint.
    pub fn on_scene(plan: RunPlan, scene: Arc<Scene>, folder: &Path, device: &OpenDevice) -> Result<Self> {
        let plan = RunPlan { config: plan.config.without_weight_files(), ..plan };
        // Stereo would match the images for minutes before a first step, but no step is taken.
        let mut untrained = plan.clone();
        untrained.config.loss.stereo.weight = Schedule::Constant(0.0);
        let (mut trainers, mut warnings): (Vec<Trainer>, Vec<String>) = (Vec::new(), Vec::new());
        let members = plan.members();
        for member in 0..members {
            let member_folder = plan.member_folder(folder, member);
            let Some(checkpoint) = load_checkpoint(&member_folder, |warning| warnings.push(warning))? else {
                let member_folder = member_folder.display();
                let left_out = || format!("{member_folder}: no checkpoint: one of {members} fields is left out");
                warnings.extend((members > 1).then(left_out));
                continue;
            };
            let mut trainer = untrained.trainer(&scene, member, trainers.first(), &device.device)?;
            trainer.resume(&checkpoint).with_context(|| member_folder.display().to_string())?;
            trainers.push(trainer);
        }
        ensure!(!trainers.is_empty(), "{}: expected a checkpoint: the run has none yet", folder.display());
        let (trainers, collapsed) = without_collapsed(trainers);
        let empty = || format!("{}: {collapsed} fields went empty and are left out", folder.display());
        warnings.extend((collapsed > 0).then(empty));
        Ok(Self::new(plan, trainers, warnings))
    }

    /// Returns the scene.
    pub fn scene(&self) -> &Arc<Scene> {
        self.trainers[0].scene()
    }

    /// Returns the renderer of the scene.
    pub fn renderer(&self) -> &Renderer {
        self.trainers[0].renderer()
    }

    /// Returns the models for pictures of `longest` pixels on their longest side.
    pub fn models_for_size(&self, longest: u32) -> Vec<TrainedModel> {
        let at_size = |model: &TrainedModel| {
            let residuals = model.residuals.as_ref().map(|residuals| residuals.for_size(longest));
            TrainedModel { residuals, ..model.clone() }
        };
        self.models.iter().map(at_size).collect()
    }

    /// Returns the fields alone, without residuals.
    pub fn fields(&self) -> Vec<TrainedModel> {
        self.models.iter().map(|model| TrainedModel { residuals: None, ..model.clone() }).collect()
    }
}

pub(super) fn total_progress(trainers: &[Trainer]) -> Progress {
    let mut total = Progress::default();
    for progress in trainers.iter().map(Trainer::progress) {
        total.step += progress.step;
        total.seconds += progress.seconds;
        total.samples_total += progress.samples_total;
        total.samples_evaluated += progress.samples_evaluated;
        total.restarts += progress.restarts;
    }
    total
}
