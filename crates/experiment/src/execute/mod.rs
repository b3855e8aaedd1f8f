//! Runs what is missing of sweeps, wherever that happens, and writes their tables and reports.

mod processes;
mod slurm;

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Result;
use infonerf_report::Record;

pub use processes::{Runner, STOPPED, Workers};
pub(crate) use slurm::refuse_under_way;
pub use slurm::{JobResources, Jobs, Slurm};

use crate::device::DeviceName;
use crate::records::save_record;
use crate::run::{Control, Existing, Finished, RunEvent, Session, Trained};
use crate::run_plan::RunPlan;
use crate::sweep::{Prepared, Sweep, SweepFiles};

/// Executor: the place where runs happen.
pub enum Executor<'a> {
    /// In this process, one after another. A run that fails ends all.
    InProcess(&'a Session),
    /// One process per run on this machine: one that fails takes no other with it.
    Processes(Workers),
    /// Each as a task of Slurm's array jobs; a last job merges.
    Slurm(Slurm),
    /// Nowhere: only the finished runs on the device are merged.
    Merge(DeviceName),
}

/// Events of sweeps that are executed.
pub enum PlanEvent<'a> {
    /// A sweep begins: what it is, and what of it is finished.
    Started(&'a Sweep, &'a Prepared),
    /// Something happens in the run `index` of this process.
    Run(usize, &'a RunPlan, RunEvent<'a>),
    /// The run `index` has ended.
    RunEnded(usize, &'a RunPlan, RunEnd),
    /// All runs of a sweep have ended, or no more of them are started.
    Over,
    /// The files of a sweep are written (`None` if no run is finished), without these runs.
    Written(&'a Sweep, Option<&'a SweepFiles>, Vec<String>),
}

/// How a run of a sweep ended.
pub enum RunEnd {
    /// In this process, with a record and its fields.
    Trained(Box<Record>, Box<Trained>),
    /// Finished before.
    Kept(Box<Record>),
    /// Finished by a process of its own; the last line that it printed.
    Finished(String),
    /// Saved and stopped on request.
    Stopped,
    /// Without a record; why.
    Failed(String),
}

/// The result of executing sweeps.
pub enum Executed {
    /// Stopped on request; the same command continues it.
    Stopped,
    /// Submitted to Slurm.
    Submitted(Jobs),
    /// All that can be done is done.
    Ended {
        /// Runs without a record.
        unfinished: usize,
        /// Files of each sweep that has a finished run.
        outcomes: Vec<SweepFiles>,
    },
}

/// Watches events, and decides whether runs in this process go on.
pub type PlanWatch<'a> = dyn FnMut(PlanEvent<'_>) -> Control + 'a;

/// Runs what is missing of `sweeps` below `out`, and writes the tables and the report of each.
///
/// # Errors
/// If a run that exists was begun in another way, another process is at work on a sweep, a scheduler refuses, a file cannot
/// be read or written, or a run of this process fails.
pub fn execute(sweeps: &[Sweep], out: &Path, executor: &Executor<'_>, watch: &mut PlanWatch<'_>) -> Result<Executed> {
    let prepare = |sweep: &Sweep| match executor {
        Executor::Merge(device) => sweep.look(out, *device),
        // Each run looks for itself, keeps its own lock, and is only removed once the new one is known to be possible.
        Executor::InProcess(session) if session.existing == Existing::Overwrite => sweep.all_missing(out),
        Executor::InProcess(session) => sweep.look(out, session.device.name),
        Executor::Processes(workers) => sweep.prepare(out, workers.runner.device),
        Executor::Slurm(slurm) => sweep.prepare(out, slurm.runner.device),
    };
    let prepared = sweeps.iter().map(prepare).collect::<Result<Vec<_>>>()?;
    if let Executor::Slurm(slurm) = executor {
        for (sweep, prepared) in sweeps.iter().zip(&prepared) {
            watch(PlanEvent::Started(sweep, prepared));
        }
        if prepared.iter().any(|prepared| !prepared.missing.is_empty()) {
            return slurm.submit(sweeps, &prepared).map(Executed::Submitted);
        }
    }
    let (mut unfinished, mut outcomes) = (0, Vec::new());
    for (sweep, prepared) in sweeps.iter().zip(&prepared) {
        if !matches!(executor, Executor::Slurm(_)) {
            watch(PlanEvent::Started(sweep, prepared));
        }
        let missing = match executor {
            Executor::InProcess(session) => run_here(session, sweep, watch)?,
            Executor::Processes(workers) => workers.run(sweep, prepared, watch),
            Executor::Slurm(_) | Executor::Merge(_) => Some(prepared.missing.iter().copied().collect()),
        };
        watch(PlanEvent::Over);
        let Some(missing) = missing else { return Ok(Executed::Stopped) };
        let outcome = sweep.write_outcome(&prepared.folder, &missing)?;
        let labels = missing.iter().map(|&run| sweep.run(run).label()).collect();
        watch(PlanEvent::Written(sweep, outcome.as_ref(), labels));
        unfinished += missing.len();
        outcomes.extend(outcome);
    }
    Ok(Executed::Ended { unfinished, outcomes })
}

/// Runs all of `sweep` in this process; `None` if `watch` stops it.
fn run_here(session: &Session, sweep: &Sweep, watch: &mut PlanWatch<'_>) -> Result<Option<BTreeSet<usize>>> {
    let folder = sweep.folder(&session.out);
    for (index, plan) in sweep.runs().enumerate() {
        let ended = match session.run(plan, &mut |event| watch(PlanEvent::Run(index, plan, event)))? {
            Finished::Record(record, trained) => {
                save_record(&folder, &record)?;
                RunEnd::Trained(record, trained)
            }
            Finished::Kept(record) => RunEnd::Kept(record),
            Finished::Stopped => RunEnd::Stopped,
        };
        let is_stopped = matches!(ended, RunEnd::Stopped);
        watch(PlanEvent::RunEnded(index, plan, ended));
        if is_stopped {
            return Ok(None);
        }
    }
    Ok(Some(BTreeSet::new()))
}
