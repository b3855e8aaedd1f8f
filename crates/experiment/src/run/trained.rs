use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, bail};
use infonerf_render::{Renderer, TrainedModel};
use infonerf_scene::Scene;
use infonerf_schedule::Schedule;
use infonerf_train::{Progress, Trainer, without_collapsed};

use super::load_checkpoint;
use crate::{Control, OpenDevice, RunEvent, RunPlan};

/// A finished or interrupted run: its fields, each as its newest checkpoint left it.
pub struct Trained {
    /// What was run.
    pub plan: RunPlan,
    /// One for each field that pictures are made of.
    pub trainers: Vec<Trainer>,
    /// Why newer checkpoints were refused, and which fields are left out.
    pub warnings: Vec<String>,
}

impl Trained {
    /// Reads the run in `folder`, as `plan` has changed it.
    ///
    /// # Errors
    /// If it has no checkpoint, or its scene cannot be read.
    pub fn read(plan: RunPlan, folder: &Path, device: &OpenDevice) -> Result<Self> {
        let scene = Arc::new(plan.load()?);
        Self::on_scene(plan, scene, folder, device)
    }

    /// The same with the plan's scene already loaded, as where checkpoints are read again while a run is trained.
    ///
    /// # Errors
    /// If it has no checkpoint.
    pub fn on_scene(plan: RunPlan, scene: Arc<Scene>, folder: &Path, device: &OpenDevice) -> Result<Self> {
        let plan = RunPlan { config: plan.config.without_weight_files(), ..plan };
        // Stereo matches the images for minutes before the first step, of which there is none.
        let mut untrained = plan.clone();
        untrained.config.loss.stereo.weight = Schedule::constant(0.0);
        let (mut trainers, mut warnings): (Vec<Trainer>, _) = (Vec::new(), Vec::new());
        for member in 0..plan.members() {
            let mut watch = |event: RunEvent<'_>| {
                if let RunEvent::Warning(warning) = event {
                    warnings.push(warning);
                }
                Control::Continue
            };
            let Some(checkpoint) = load_checkpoint(&plan.member_folder(folder, member), &mut watch)? else { break };
            let mut trainer = untrained.trainer(&scene, member, trainers.first(), &device.device)?;
            trainer.resume(&checkpoint)?;
            trainers.push(trainer);
        }
        if trainers.is_empty() {
            bail!("{}: expected a checkpoint: the run has none yet", folder.display());
        }
        let (trainers, collapsed) = without_collapsed(trainers);
        if collapsed > 0 {
            warnings.push(format!("{}: {collapsed} fields went empty and are left out", folder.display()));
        }
        Ok(Self { plan, trainers, warnings })
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        self.trainers[0].scene()
    }

    /// The renderer of the scene.
    pub fn renderer(&self) -> &Renderer {
        self.trainers[0].renderer()
    }

    /// What pictures are rendered from: the fields alone. Worth keeping.
    pub fn models(&self) -> Vec<TrainedModel> {
        self.trainers.iter().map(Trainer::trained).collect()
    }

    /// The same with the residuals of the training views, if `render.residuals` says so.
    pub fn models_with_residuals(&self) -> Vec<TrainedModel> {
        self.trainers.iter().map(Trainer::trained_with_residuals).collect()
    }
}

/// Steps, seconds, samples and fresh starts of all fields together.
pub fn total_progress(trainers: &[Trainer]) -> Progress {
    let mut total = Progress::default();
    for progress in trainers.iter().map(Trainer::progress) {
        total.step += progress.step;
        total.seconds += progress.seconds;
        total.samples_total += progress.samples_total;
        total.samples_evaluated += progress.samples_evaluated;
        total.restarts += progress.restarts;
        total.pixels_skipped += progress.pixels_skipped;
    }
    total
}
