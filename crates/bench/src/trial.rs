//! Runs of a benchmark: trained and evaluated ones, and single steps.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use infonerf_experiment::{Control, Finished, RunPlan};
use infonerf_report::Record;
use infonerf_train::{Config, Event, Outcome, Trainer, config};

use crate::context::Bench;

impl Bench {
    /// Prepares `plan` for its first step.
    pub(crate) fn trainer(&self, plan: &RunPlan) -> Result<Trainer> {
        plan.trainer(&Arc::new(plan.load()?), 0, None, self.device()).with_context(|| plan.label())
    }

    /// Trains `plan` to its end and evaluates it on its test views; its folder replaces that of an earlier run.
    pub(crate) fn trial(&self, plan: &RunPlan) -> Result<Record> {
        match self.session.run(plan, &mut |_| Control::Continue).with_context(|| plan.label())? {
            Finished::Record(record, _) => Ok(record.representable()),
            Finished::Kept(_) | Finished::Stopped => bail!("{}: the run has no record", plan.label()),
        }
    }
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

/// Computes the mean of a quantity over runs; `None` if one lacks it.
pub(crate) fn mean(records: &[&Record], value: impl Fn(&Record) -> Option<f64>) -> Option<f64> {
    let values: Option<Vec<f64>> = records.iter().map(|record| value(record)).collect();
    let values = values.filter(|values| !values.is_empty())?;
    Some(values.iter().sum::<f64>() / values.len() as f64)
}
