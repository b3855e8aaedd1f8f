//! Training of one model on all scenes of an experiment, for other runs to begin with.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use infonerf_scene::Scene;
use infonerf_train::{Progress, Trainer};

use crate::run::{Training, clear, load_checkpoint, lock, train};
use crate::{Experiment, Identity, Resume, RunEvent, RunPlan, Session, Watch};

/// What came of pre-training.
pub struct Pretrained {
    /// Folder of the weights: what `train.init` takes.
    pub folder: PathBuf,
    /// How far it is.
    pub progress: Progress,
    /// Whether it is done; otherwise it was stopped and can be resumed.
    pub finished: bool,
}

/// Trains one model on all scenes of `experiment`, which has one variant and one seed, in a folder of its name.
///
/// # Errors
/// As [`Session::run`], and if the experiment has several variants or seeds.
pub fn pretrain(session: &Session, experiment: &Experiment, watch: &mut Watch<'_>) -> Result<Pretrained> {
    let plan = experiment.runs.first().context("expected at least one scene")?;
    if experiment.runs.iter().any(|other| (&other.variant, other.seed) != (&plan.variant, plan.seed)) {
        bail!("{}: expected one variant and one seed: choose with --variant and --seed", experiment.about.name);
    }
    let folder = session.experiment_folder(&experiment.about.name);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let (_lock, warning) = lock(&folder, "run")?;
    if let Some(warning) = warning {
        watch(RunEvent::Warning(warning));
    }
    let config = plan.to_toml_with(experiment.runs.iter().map(|plan| plan.scene.clone()).collect())?;
    let path = folder.join("config.toml");
    let begun = fs::read_to_string(&path).ok();
    let identity =
        Identity::of_scenes(plan, experiment.runs.iter().map(|plan| &plan.source), session.device.name.name())?;
    if session.resume == Resume::Never || begun.is_none() {
        clear(&folder)?;
    } else if begun.as_ref() != Some(&config) || Identity::read(&folder).as_ref() != Some(&identity) {
        bail!("{}: --resume needs the config, data, program and device that it began with", folder.display());
    }
    infonerf_report::write_atomically(&path, config.as_bytes())?;
    identity.write(&folder)?;
    watch(RunEvent::Loading);
    let scenes = experiment.runs.iter().map(training_views).collect::<Result<Vec<_>>>()?;
    let mut trainer = Trainer::on_scenes(&plan.config, scenes, plan.seed, &session.device.device)?;
    if let Some(checkpoint) = load_checkpoint(&folder, watch)? {
        trainer.resume(&checkpoint)?;
    }
    watch(RunEvent::Started { fields: 0..1, of: 1 });
    let mut training = [Training::new(trainer, folder.clone())?];
    train(&mut training, plan.config.train.checkpoint_every, session.until, watch)?;
    watch(RunEvent::Ended);
    let [field] = training;
    let (trainer, ended) = field.into_parts();
    let finished = matches!(ended, crate::run::Ended::Over(_));
    Ok(Pretrained { folder, progress: trainer.progress().clone(), finished })
}

/// A scene with as few test views as can be: none is looked at.
fn training_views(plan: &RunPlan) -> Result<Arc<Scene>> {
    let mut plan = plan.clone();
    plan.config.eval.test = "first-1".parse().map_err(anyhow::Error::msg)?;
    Ok(Arc::new(plan.load()?))
}
