//! Training and evaluating in memory, without a run folder: only the measurements are kept.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use infonerf_experiment::{RunPlan, total_progress};
use infonerf_metrics::{METRICS, Values};
use infonerf_render::TrainedModel;
use infonerf_train::{Config, Evaluation, Event, Outcome, Trainer, config, step_side_by_side, without_collapsed};
use serde::Serialize;

use super::context::Bench;

/// A trained run and what its test views say.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Trial {
    pub(super) scene: String,
    pub(super) variant: String,
    pub(super) seed: u64,
    /// How many.
    pub(super) train_views: usize,
    pub(super) iterations: usize,
    pub(super) train_seconds: f64,
    pub(super) render_seconds_per_image: f64,
    pub(super) samples_total: u64,
    pub(super) samples_evaluated: u64,
    pub(super) collapsed: bool,
    #[serde(flatten)]
    pub(super) metrics: Values,
}

impl Bench {
    /// `plan` before its first step.
    pub(super) fn trainer(&self, plan: &RunPlan) -> Result<Trainer> {
        plan.trainer(&Arc::new(plan.load()?), 0, None, &self.device).with_context(|| plan.label())
    }

    /// Trains `plan` to its end and evaluates it on its test views.
    pub(super) fn trial(&self, plan: &RunPlan) -> Result<Trial> {
        let scene = Arc::new(plan.load()?);
        let mut trainers: Vec<Trainer> = Vec::new();
        for index in 0..plan.members() {
            trainers.push(plan.trainer(&scene, index, trainers.first(), &self.device)?);
        }
        for trainers in trainers.chunks_mut(self.side_by_side) {
            train_all(trainers).with_context(|| plan.label())?;
        }
        let progress = total_progress(&trainers);
        let (trainers, _) = without_collapsed(trainers);
        let members: Vec<TrainedModel> = trainers.iter().map(Trainer::trained).collect();
        let protocol = plan.config.eval.metric_protocol();
        let mut evaluation = Evaluation::new(&self.networks, &protocol);
        for view in &scene.test {
            evaluation.add(trainers[0].renderer(), &members, view)?;
        }
        let evaluated = evaluation.finish().context("no test views")?;
        Ok(Trial {
            scene: plan.scene.clone(),
            variant: plan.variant.clone(),
            seed: plan.seed,
            train_views: scene.train.len(),
            iterations: progress.step,
            train_seconds: progress.seconds,
            render_seconds_per_image: evaluated.seconds_per_image,
            samples_total: progress.samples_total,
            samples_evaluated: progress.samples_evaluated,
            collapsed: trainers[0].has_collapsed(),
            metrics: evaluated.measured.representable().set,
        })
    }
}

impl Trial {
    /// The metric of this key; none where it could not be computed.
    pub(super) fn metric(&self, key: &str) -> Option<f64> {
        self.metrics.get(key).copied().flatten()
    }

    /// PSNR in dB.
    pub(super) fn psnr(&self) -> f64 {
        self.metric("psnr").unwrap_or(f64::NAN)
    }
}

/// Takes all steps of fields side by side.
fn train_all(trainers: &mut [Trainer]) -> Result<()> {
    let mut active: Vec<&mut Trainer> = trainers.iter_mut().collect();
    while !active.is_empty() {
        let mut outcomes = step_side_by_side(&mut active).into_iter();
        let mut next = Vec::with_capacity(active.len());
        for trainer in active {
            if outcomes.next().map(|(_, outcome)| outcome).transpose()? == Some(Outcome::Running) {
                next.push(trainer);
            }
        }
        active = next;
    }
    Ok(())
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

/// Takes `count` steps and tells how many seconds each took: an equal share of those that are reported together. Ends early
/// where the run does.
pub(super) fn step_seconds(trainer: &mut Trainer, count: usize) -> Result<Vec<f64>> {
    let mut seconds = Vec::with_capacity(count);
    let mut start = Instant::now();
    for step in 1..=count {
        let mut reported = 0;
        let mut report = |event| reported += usize::from(matches!(event, Event::Step { .. }));
        let is_last = trainer.step(&mut report)? != Outcome::Running || step == count;
        if is_last {
            trainer.catch_up(&mut report)?;
        }
        if reported > 0 {
            seconds.extend(std::iter::repeat_n(start.elapsed().as_secs_f64() / reported as f64, reported));
            start = Instant::now();
        }
        if is_last {
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

/// Mean of each metric over trials; none where a trial lacks it.
pub(super) fn mean_metrics(trials: &[&Trial]) -> Values {
    METRICS.iter().map(|metric| (metric.key().to_owned(), mean(trials, |trial| trial.metric(metric.key())))).collect()
}
