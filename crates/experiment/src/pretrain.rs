//! Training of one model on all scenes of an experiment, to initialise other runs.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use infonerf_scene::{PixelCount, TestProtocol};
use infonerf_train::{Checkpoint, MemoryPlan, Progress, Trainer};

use crate::identity::Identity;
use crate::plan::Experiment;
use crate::run::{RunEvent, Session, Training, Watch, load_checkpoint, train};
use crate::run_plan::RunPlan;

/// The result of pre-training.
pub struct Pretrained {
    /// Folder of the weights, a value for `train.init`.
    pub folder: PathBuf,
    /// Progress of the pre-training.
    pub progress: Progress,
    /// Whether all steps are taken; otherwise the training was stopped and can be resumed.
    pub finished: bool,
}

/// Trains one model on all scenes of `experiment`, which has one variant and one seed, in the experiment's folder.
///
/// # Errors
/// As [`Session::run`], and if the experiment has several variants or seeds.
pub fn pretrain(session: &Session, experiment: &Experiment, watch: &mut Watch<'_>) -> Result<Pretrained> {
    let plan = experiment.runs.first().context("expected at least one scene")?;
    if experiment.runs.iter().any(|other| (&other.variant, other.seed) != (&plan.variant, plan.seed)) {
        bail!("{}: expected one variant and one seed: choose with --variant and --seed", experiment.about.name);
    }
    let config = plan.to_toml_with(experiment.runs.iter().map(|plan| plan.scene.clone()).collect())?;
    let identity = Identity::of(&experiment.runs, session.device.name.name())?;
    let folder = session.out.join(&experiment.about.name);
    let run = session.open_run(folder.clone(), identity, config, watch)?;
    let earlier = if run.continues { Checkpoint::load(&folder)?.0 } else { None };
    let earlier = earlier.map(|checkpoint| checkpoint.progress().clone());
    if let Some(progress) = earlier.filter(|progress| progress.step >= plan.config.train.iterations) {
        return Ok(Pretrained { folder, progress, finished: true });
    }
    // Pre-training uses no test view, and a scene has at least one.
    let mut plans = experiment.runs.clone();
    plans.iter_mut().for_each(|plan| plan.config.eval.test = TestProtocol::First(1));
    check_memory(&plans)?;
    run.begin(&folder)?;
    watch(RunEvent::Loading);
    let scenes = plans.iter().map(|plan| plan.load().map(Arc::new)).collect::<Result<Vec<_>>>()?;
    let mut trainer = Trainer::on_scenes(&plan.config, scenes, plan.seed, &session.device.device)?;
    if let Some(checkpoint) = load_checkpoint(&folder, |warning| _ = watch(RunEvent::Warning(warning)))? {
        trainer.resume(&checkpoint).with_context(|| folder.display().to_string())?;
    }
    watch(RunEvent::Started { fields: 0..1, of: 1 });
    let mut training = [Training::new(trainer, folder.clone())?];
    train(&mut training, plan.config.train.checkpoint_every, watch)?;
    watch(RunEvent::Ended);
    let [field] = training;
    Ok(Pretrained { folder, progress: field.trainer.progress().clone(), finished: field.is_over })
}

/// Returns an error if the scenes would not fit into memory together, before any of them is loaded.
fn check_memory(plans: &[RunPlan]) -> Result<()> {
    let mut all = PixelCount { views: 0, train: 0, test: 0 };
    for plan in plans {
        let PixelCount { train, test, .. } = plan.pixels()?;
        (all.train, all.test) = (all.train.saturating_add(train), all.test.saturating_add(test));
    }
    Ok(MemoryPlan::new(&plans[0].config, all, 1, 1).check_available()?)
}
