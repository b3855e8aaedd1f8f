//! Executes the missing runs of sweeps, in this process or in others, and writes tables and reports.

mod processes;
mod slurm;

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Result;
use infonerf_report::Record;

pub use processes::{Runner, STOPPED, Workers, cores};
pub(crate) use slurm::check_no_running_jobs;
pub use slurm::{Jobs, Slurm};

use crate::device::DeviceName;
use crate::records::save_record;
use crate::run::{Control, Existing, Finished, RunEvent, Session, Trained};
use crate::sweep::{Prepared, Sweep, SweepFiles};

/// Place where runs are executed.
pub enum Executor<'a> {
    /// This process, one run after another. Once one has begun to train, a run that fails does not affect the others.
    InProcess(&'a Session),
    /// One process per run on this machine. A run that fails does not affect the others.
    Processes(Workers),
    /// Slurm: each run is a task of an array job, and a last job merges the results.
    Slurm(Slurm),
    /// No place: runs that are finished on the device are merged, and none is started.
    Merge(DeviceName),
}

/// Events of the execution of sweeps.
pub enum PlanEvent<'a> {
    /// A sweep begins. [`Prepared`] lists its missing runs.
    Started(&'a Sweep, &'a Prepared),
    /// An event of the sweep's run of that index, which is executed in this process.
    Run(&'a Sweep, usize, RunEvent<'a>),
    /// The sweep's run of that index has ended.
    RunEnded(&'a Sweep, usize, RunEnd),
    /// All runs of a sweep have ended, or the sweep was stopped.
    Ended,
    /// The files of a sweep are written (`None` if no run is finished). The last field lists the labels of its unfinished runs.
    Written(&'a Sweep, Option<&'a SweepFiles>, Vec<String>),
}

/// Outcome of a run of a sweep.
pub enum RunEnd {
    /// Trained and evaluated in this process: the record and the fields.
    Trained(Box<Record>, Box<Trained>),
    /// Finished by an earlier execution: the record.
    AlreadyDone(Box<Record>),
    /// Finished in a process of its own: the last line that this process printed.
    Finished(String),
    /// Saved and stopped on request.
    Stopped,
    /// Failed, without a record: the reason.
    Failed(String),
}

/// The result of executing sweeps.
pub enum Executed {
    /// Stopped on request. The same command continues the execution.
    Stopped,
    /// Submitted to Slurm.
    Submitted(Jobs),
    /// Ended, with the results written.
    Ended {
        /// Number of runs without a record.
        unfinished: usize,
        /// Files of each sweep that has a finished run.
        outcomes: Vec<SweepFiles>,
    },
}

/// Callback that receives events, and decides whether runs in this process go on.
pub type PlanWatch<'a> = dyn FnMut(PlanEvent<'_>) -> Control + 'a;

/// Executes the missing runs of `sweeps` below `out`, and writes the tables and the report of each sweep.
///
/// # Errors
/// If an existing run was begun with other settings, another process is at work on a sweep, a scheduler refuses, a file cannot
/// be read or written, or a run of this process fails before one has begun to train, or is the only one.
pub fn execute(sweeps: &[Sweep], out: &Path, executor: &Executor<'_>, watch: &mut PlanWatch<'_>) -> Result<Executed> {
    let prepare = |sweep: &Sweep| match executor {
        Executor::Merge(device) => sweep.find_missing(out, *device),
        // Each run locks its folder itself, and removes earlier results only once its own training can start.
        Executor::InProcess(session) if session.existing == Existing::Overwrite => sweep.all_missing(out),
        Executor::InProcess(session) => sweep.find_missing(out, session.device.name),
        Executor::Processes(workers) => sweep.prepare(out, workers.runner.device),
        Executor::Slurm(slurm) => sweep.prepare(out, slurm.runner.device),
    };
    let prepared = sweeps.iter().map(prepare).collect::<Result<Vec<_>>>()?;
    if let Executor::Slurm(slurm) = executor
        && prepared.iter().any(|prepared| !prepared.missing.is_empty())
    {
        for (sweep, prepared) in sweeps.iter().zip(&prepared) {
            watch(PlanEvent::Started(sweep, prepared));
        }
        return slurm.submit(sweeps, &prepared).map(Executed::Submitted);
    }
    let (mut unfinished, mut outcomes) = (0, Vec::new());
    for (sweep, prepared) in sweeps.iter().zip(&prepared) {
        watch(PlanEvent::Started(sweep, prepared));
        let missing = match executor {
            Executor::InProcess(session) => {
                // A scene that cannot be read is reported before another is trained on.
                prepared.missing.iter().try_for_each(|&run| sweep.run(run).pixels().map(drop))?;
                run_here(session, sweep, watch)?
            }
            Executor::Processes(workers) => workers.run(sweep, prepared, watch),
            Executor::Slurm(_) | Executor::Merge(_) => Some(prepared.missing.iter().copied().collect()),
        };
        watch(PlanEvent::Ended);
        let Some(missing) = missing else { return Ok(Executed::Stopped) };
        let outcome = sweep.write_outcome(&prepared.folder, &missing)?;
        let labels = missing.iter().map(|&run| sweep.run(run).label()).collect();
        watch(PlanEvent::Written(sweep, outcome.as_ref(), labels));
        unfinished += missing.len();
        outcomes.extend(outcome);
    }
    Ok(Executed::Ended { unfinished, outcomes })
}

/// Executes all runs of `sweep` in this process, and returns those that failed; `None` if `watch` stops one of them.
fn run_here(session: &Session, sweep: &Sweep, watch: &mut PlanWatch<'_>) -> Result<Option<BTreeSet<usize>>> {
    let (folder, mut failed, mut trains) = (sweep.folder(&session.out), BTreeSet::new(), false);
    for (index, plan) in sweep.runs().enumerate() {
        let mut watch_run = |event: RunEvent<'_>| {
            trains |= matches!(event, RunEvent::Started { .. });
            watch(PlanEvent::Run(sweep, index, event))
        };
        let ended = match session.run(plan, &mut watch_run) {
            Ok(Finished::Record(record, trained)) => {
                save_record(&folder, &record)?;
                RunEnd::Trained(record, trained)
            }
            Ok(Finished::AlreadyDone(record)) => RunEnd::AlreadyDone(record),
            Ok(Finished::Stopped) => RunEnd::Stopped,
            Err(error) if !trains || sweep.runs().len() == 1 => return Err(error),
            Err(error) => {
                failed.insert(index);
                RunEnd::Failed(format!("{error:#}"))
            }
        };
        let is_stopped = matches!(ended, RunEnd::Stopped);
        watch(PlanEvent::RunEnded(sweep, index, ended));
        if is_stopped {
            return Ok(None);
        }
    }
    Ok(Some(failed))
}
