//! Training and evaluation in memory, without a run folder.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use infonerf_experiment::{RunPlan, total_progress};
use infonerf_metrics::{METRICS, Values};
use infonerf_render::TrainedModel;
use infonerf_train::{Config, Evaluation, Event, Outcome, Trainer, config, step_side_by_side, without_collapsed};
use serde::Serialize;

use crate::context::Bench;

/// Measurements of a trained and evaluated run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Trial {
    pub(crate) scene: String,
    pub(crate) variant: String,
    pub(crate) seed: u64,
    pub(crate) train_views: usize,
    pub(crate) iterations: usize,
    pub(crate) train_seconds: f64,
    pub(crate) render_seconds_per_image: f64,
    pub(crate) samples_total: u64,
    pub(crate) samples_evaluated: u64,
    pub(crate) collapsed: bool,
    #[serde(flatten)]
    pub(crate) metrics: Values,
}

impl Bench {
    /// Prepares `plan` for its first step.
    pub(crate) fn trainer(&self, plan: &RunPlan) -> Result<Trainer> {
        plan.trainer(&Arc::new(plan.load()?), 0, None, &self.device).with_context(|| plan.label())
    }

    /// Trains `plan` to its end and evaluates it on its test views.
    pub(crate) fn trial(&self, plan: &RunPlan) -> Result<Trial> {
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
    /// Returns the metric `key`; `None` if it could not be computed.
    pub(crate) fn metric(&self, key: &str) -> Option<f64> {
        metric_of(&self.metrics, key)
    }

    /// Returns the PSNR in dB.
    pub(crate) fn psnr(&self) -> f64 {
        self.metric("psnr").unwrap_or(f64::NAN)
    }
}

/// Returns the metric `key` of `values`; `None` if it could not be computed.
pub(crate) fn metric_of(values: &Values, key: &str) -> Option<f64> {
    values.get(key).copied().flatten()
}

/// Trains fields side by side to their ends.
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

/// Trains to the end.
pub(crate) fn train(trainer: &mut Trainer) -> Result<Outcome> {
    loop {
        match trainer.step(&mut |_| ())? {
            Outcome::Running => {}
            outcome => return Ok(outcome),
        }
    }
}

/// Takes `count` steps, or fewer if the run ends, and returns the seconds of each: steps that are reported together share
/// their time equally.
pub(crate) fn step_seconds(trainer: &mut Trainer, count: usize) -> Result<Vec<f64>> {
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

/// Returns `plan` with some keys of its config changed.
pub(crate) fn with_settings<S: AsRef<str>>(plan: &RunPlan, settings: &[S]) -> Result<RunPlan> {
    let mut table = toml::Table::try_from(&plan.config)?;
    for setting in settings {
        config::assign(&mut table, setting.as_ref())?;
    }
    Ok(RunPlan { config: Config::from_table(table)?, ..plan.clone() })
}

/// Computes the mean of a quantity over trials; `None` if a trial lacks it.
pub(crate) fn mean(trials: &[&Trial], value: impl Fn(&Trial) -> Option<f64>) -> Option<f64> {
    let values: Option<Vec<f64>> = trials.iter().map(|trial| value(trial)).collect();
    let values = values.filter(|values| !values.is_empty())?;
    Some(values.iter().sum::<f64>() / values.len() as f64)
}

/// Computes the mean of each metric over trials; `None` if a trial lacks it.
pub(crate) fn mean_metrics(trials: &[&Trial]) -> Values {
    METRICS.iter().map(|metric| (metric.key().to_owned(), mean(trials, |trial| trial.metric(metric.key())))).collect()
}
