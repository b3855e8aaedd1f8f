//! Runs of a benchmark: trained and evaluated ones, and single steps.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use infonerf_experiment::{Finished, RunEvent, RunPlan, Watch};
use infonerf_report::{Record, Setting};
use infonerf_train::{Config, Event, Outcome, Trainer, config};

use crate::context::Bench;

impl Bench {
    pub(crate) fn trainer(&self, plan: &RunPlan) -> Result<Trainer> {
        let device = &self.session.device.device;
        plan.trainer(&Arc::new(plan.load()?), 0, None, device).with_context(|| plan.label())
    }

    /// Trains `plan` to its end and evaluates it on its test views; its folder replaces that of an earlier run.
    pub(crate) fn trial(&self, plan: &RunPlan, watch: &mut Watch<'_>) -> Result<Record> {
        match self.session.run(plan, watch).with_context(|| plan.label())? {
            Finished::Record(record, _) => Ok(record.representable()),
            Finished::AlreadyDone(_) | Finished::Stopped => bail!("{}: the run has no record", plan.label()),
        }
    }
}

pub(crate) fn train(trainer: &mut Trainer, watch: &mut Watch<'_>) -> Result<()> {
    watch(RunEvent::Started { fields: 0..1, of: 1 });
    let mut outcome = Outcome::Running;
    while outcome == Outcome::Running {
        let mut events = Vec::new();
        outcome = trainer.step(&mut |event| events.push(event))?;
        for event in &events {
            watch(RunEvent::Training { event, trainer: &*trainer });
        }
    }
    watch(RunEvent::Ended);
    Ok(())
}

/// Takes `count` steps, or fewer if the run ends, and returns the seconds of each; steps reported together share theirs equally.
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

pub(crate) fn with_settings<S: AsRef<str>>(plan: &RunPlan, settings: impl IntoIterator<Item = S>) -> Result<RunPlan> {
    let mut table = toml::Table::try_from(&plan.config)?;
    for setting in settings {
        config::assign(&mut table, setting.as_ref())?;
    }
    Ok(RunPlan { config: Config::from_table(table)?, ..plan.clone() })
}

/// Labels a record with a value that its run was measured with. Tables show the value in a column `key`.
pub(crate) fn measured_with(record: Record, key: &str, value: String) -> Record {
    let variant = format!("{}, {key} {value}", record.variant);
    let setting = Setting { variant: record.variant, values: [(key.to_owned(), value)].into_iter().collect() };
    Record { variant, setting: Some(setting), ..record }
}
