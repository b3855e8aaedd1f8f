//! Submitting items as jobs of a scheduler.

use std::ffi::OsString;

use anyhow::{Context, Result};

use super::array::Array;
use super::jobs::Jobs;
use super::{Batch, Live, Runner, Scheduler};

/// Jobs that were submitted.
#[derive(Clone, Debug)]
pub struct Launched {
    /// Their ids, that of the job that merges last.
    pub jobs: Vec<String>,
    /// Whether a job will merge.
    pub merges: bool,
    /// What they run.
    batches: Vec<Batch>,
}

/// How far jobs are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Items that are finished.
    pub finished: usize,
    /// Tasks that have not ended.
    pub live: Live,
}

/// Submits every item of `batches`, and `merge` to run when all of them have ended.
///
/// # Errors
/// What the scheduler said, on one line. What it has taken before stays submitted: the line says what.
pub fn submit(batches: Vec<Batch>, scheduler: &dyn Scheduler, runner: &Runner, merge: &[OsString]) -> Result<Launched> {
    let limit = scheduler.array_limit()?;
    let mut all: Vec<String> = Vec::new();
    let mut lists = Vec::new();
    for batch in &batches {
        let mut jobs = Jobs { launcher: scheduler.launcher(), ids: Vec::new() };
        for array in Array::of(&batch.items, limit) {
            let after = jobs.ids.last().map(String::as_str);
            let id = scheduler.submit(batch, &array, runner, after).with_context(|| refused(batch, &array, &all))?;
            all.push(id.clone());
            jobs.ids.push(id);
            jobs.write(&batch.folder)?;
        }
        lists.push(jobs);
    }
    let place = batches.first().context("expected items to submit")?;
    let merging = scheduler.submit_merge(place, &all, merge).with_context(|| {
        format!("jobs {} are submitted, the job that merges is not: the same command with --merge does", all.join(", "))
    })?;
    if let Some(id) = &merging {
        for (batch, mut jobs) in batches.iter().zip(lists) {
            jobs.ids.push(id.clone());
            jobs.write(&batch.folder)?;
        }
        all.push(id.clone());
    }
    Ok(Launched { jobs: all, merges: merging.is_some(), batches })
}

/// What was not submitted, and what was.
fn refused(batch: &Batch, array: &Array, jobs: &[String]) -> String {
    let (first, last) = array.ends();
    let refused = format!("{}: items {first} to {last} were not submitted", batch.name);
    match jobs {
        [] => refused,
        jobs => format!(
            "{refused} (those before are, as {}: the same command, without --overwrite, submits the rest when they have ended)",
            jobs.join(", ")
        ),
    }
}

impl Launched {
    /// Number of items.
    pub fn items(&self) -> usize {
        self.batches.iter().map(|batch| batch.items.len()).sum()
    }

    /// How far they are.
    ///
    /// # Errors
    /// If the scheduler does not answer.
    pub fn progress(&self, scheduler: &dyn Scheduler) -> Result<Progress> {
        // Asked first: what has ended by then has left its record.
        let live = scheduler.live(&self.jobs)?;
        let finished = self.batches.iter().flat_map(|batch| &batch.records).filter(|record| record.exists()).count();
        Ok(Progress { finished, live })
    }
}
