//! Training and evaluating in memory: nothing of it is kept but what was measured.

use anyhow::{Context, Result};
use infonerf_train::{Config, Evaluation, Outcome, Trainer, config, evaluate_view};
use serde::Serialize;

use super::context::Bench;
use crate::experiment::RunPlan;
use crate::run::{self, learned, total};

/// A trained run and what its test views say.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Trial {
    pub(super) scene: String,
    pub(super) variant: String,
    pub(super) seed: u64,
    pub(super) iterations: usize,
    pub(super) train_seconds: f64,
    pub(super) render_seconds_per_image: f64,
    pub(super) samples_total: u64,
    pub(super) samples_evaluated: u64,
    pub(super) psnr: f64,
    pub(super) ssim: Option<f64>,
    pub(super) gmsd: f64,
    pub(super) sharpness: Option<f64>,
    pub(super) collapsed: bool,
}

impl Bench {
    /// `plan` before its first step.
    pub(super) fn trainer(&self, plan: &RunPlan) -> Result<Trainer> {
        plan.trainer(run::load(plan)?, 0, &self.device).with_context(|| plan.label())
    }

    /// Trains `plan` to its end and evaluates it on its test views.
    pub(super) fn trial(&self, plan: &RunPlan) -> Result<Trial> {
        let scene = run::load(plan)?;
        let mut trainers = Vec::new();
        let mut collapsed = false;
        for index in 0..plan.members() {
            let mut trainer = plan.trainer(scene.clone(), index, &self.device)?;
            collapsed |= train(&mut trainer).with_context(|| plan.label())? == Outcome::Collapsed;
            trainers.push(trainer);
        }
        let members = learned(&trainers);
        let views: Result<Vec<_>, _> =
            scene.test.iter().map(|view| evaluate_view(trainers[0].renderer(), &members, view)).collect();
        let progress = total(&trainers);
        let mean = Evaluation::mean(&views?).context("no test views")?;
        Ok(Trial {
            scene: plan.scene.clone(),
            variant: plan.variant.clone(),
            seed: plan.seed,
            iterations: progress.step,
            train_seconds: progress.seconds,
            render_seconds_per_image: mean.seconds,
            samples_total: progress.samples_total,
            samples_evaluated: progress.samples_evaluated,
            psnr: mean.comparison.psnr,
            ssim: mean.comparison.ssim,
            gmsd: mean.comparison.gmsd,
            sharpness: mean.comparison.sharpness,
            collapsed,
        })
    }
}

/// Takes all steps.
pub(super) fn train(trainer: &mut Trainer) -> Result<Outcome> {
    loop {
        match trainer.step(&mut |_| ())? {
            Outcome::Running => {}
            outcome => return Ok(outcome),
        }
    }
}

/// Takes `count` steps and tells how many seconds each took. Ends early where the run does.
pub(super) fn step_seconds(trainer: &mut Trainer, count: usize) -> Result<Vec<f64>> {
    let mut seconds = Vec::with_capacity(count);
    for _ in 0..count {
        let before = trainer.progress().seconds;
        let outcome = trainer.step(&mut |_| ())?;
        seconds.push(trainer.progress().seconds - before);
        if outcome != Outcome::Running {
            break;
        }
    }
    Ok(seconds)
}

/// The same run with some keys of its config changed.
pub(super) fn with_settings<S: AsRef<str>>(plan: &RunPlan, settings: &[S]) -> Result<RunPlan> {
    let mut table = toml::Table::try_from(&plan.config)?;
    for setting in settings {
        config::assign(&mut table, setting.as_ref())?;
    }
    Ok(RunPlan { config: Config::from_table(table)?, ..plan.clone() })
}

/// Mean of a quantity over trials; none where a trial lacks it.
pub(super) fn mean(trials: &[&Trial], value: impl Fn(&Trial) -> Option<f64>) -> Option<f64> {
    let values: Option<Vec<f64>> = trials.iter().map(|trial| value(trial)).collect();
    let values = values.filter(|values| !values.is_empty())?;
    Some(values.iter().sum::<f64>() / values.len() as f64)
}
