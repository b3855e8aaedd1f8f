//! Runs of a sweep as processes of this machine.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use infonerf_train::available_memory;

use super::{PlanEvent, PlanWatch, RunEnd};
use crate::device::DeviceName;
use crate::sweep::{Prepared, Sweep, manifest};

/// Exit code of an item's process that stopped on request.
pub const STOPPED: i32 = 130;

/// Share of the free memory that all runs together may take. Each takes `PROGRAM_BYTES` in addition to its estimate.
const MEMORY_SHARE: f64 = 0.8;
const PROGRAM_BYTES: u64 = 256 << 20;

/// Program that runs items of a manifest, with its options.
#[derive(Clone, Debug)]
pub struct Runner {
    /// Path of the program: `PROGRAM sweep-item MANIFEST ITEM` runs an item.
    pub program: PathBuf,
    /// Device to compute on.
    pub device: DeviceName,
    /// File or folder with weights of learned metrics, searched in addition to the default places.
    pub weights: Option<PathBuf>,
    /// Time limit of a run.
    pub timeout: Option<Duration>,
}

/// Settings for runs in processes of this machine.
#[derive(Clone, Debug)]
pub struct Workers {
    /// Program that runs the items.
    pub runner: Runner,
    /// Maximum number of runs at a time. The number of cores and the free memory may limit it further.
    pub jobs: usize,
    /// Returns whether no more runs should be started.
    pub stop: fn() -> bool,
}

impl Runner {
    /// Returns the command that runs an item, without its last argument: the number of the item.
    pub(super) fn command(&self, manifest: &Path) -> Vec<OsString> {
        let mut command: Vec<OsString> =
            vec![self.program.clone().into(), "sweep-item".into(), "--device".into(), self.device.name().into()];
        if let Some(weights) = &self.weights {
            command.extend(["--weights".into(), weights.into()]);
        }
        if let Some(timeout) = self.timeout {
            command.extend(["--timeout".into(), format!("{}s", timeout.as_secs_f64()).into()]);
        }
        command.push(manifest.into());
        command
    }

    /// Runs an item of `manifest` while `jobs - 1` others run, tells it to stop once `stop` returns true, and returns how it ended.
    fn run(&self, manifest: &Path, item: usize, jobs: usize, stop: fn() -> bool) -> RunEnd {
        let words = self.command(manifest);
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).arg(item.to_string()).arg("--tied");
        if jobs > 1 {
            command.env("RAYON_NUM_THREADS", (cores() / jobs).max(1).to_string());
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let output = command.spawn().and_then(|mut child| {
            // The item stops at the end of its input: when it is told to, or when this process dies.
            let mut input = child.stdin.take();
            let output = thread::spawn(|| child.wait_with_output());
            while !output.is_finished() {
                input.take_if(|_| stop());
                thread::sleep(Duration::from_millis(20));
            }
            output.join().expect("waiting does not panic")
        });
        output.map_or_else(|error| RunEnd::Failed(error.to_string()), |output| run_end(&output))
    }
}

impl Workers {
    /// Executes the missing runs of `sweep`, and returns those that failed, or `None` if the execution was stopped on request.
    pub(super) fn run(&self, sweep: &Sweep, prepared: &Prepared, watch: &mut PlanWatch<'_>) -> Option<BTreeSet<usize>> {
        let manifest = prepared.folder.join(manifest::NAME);
        let (mut failed, mut stopped) = (BTreeSet::new(), false);
        // Runs that differ in their seed alone need as much. If a scene cannot be read, the run itself reports the error.
        let mut kinds = BTreeSet::new();
        let plans = prepared.missing.iter().map(|&item| sweep.run(item));
        let plans = plans.filter(|plan| kinds.insert((&plan.scene, &plan.variant)));
        let needed = plans.filter_map(|plan| plan.memory(self.runner.device.fields_side_by_side()).ok());
        let needed = needed.map(|needed| needed.total().saturating_add(PROGRAM_BYTES)).max();
        let jobs = fitting(self.jobs.min(prepared.missing.len()), cores(), available_memory(), needed);
        let queue = Mutex::new(prepared.missing.iter().copied());
        let next = || queue.lock().ok().filter(|_| !(self.stop)()).and_then(|mut queue| queue.next());
        thread::scope(|scope| {
            let (sender, receiver) = mpsc::channel();
            for _ in 0..jobs {
                let (sender, next, manifest) = (sender.clone(), &next, &manifest);
                scope.spawn(move || {
                    while let Some(item) = next() {
                        if sender.send((item, self.runner.run(manifest, item, jobs, self.stop))).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (item, end) in receiver {
                match &end {
                    RunEnd::Failed(_) => drop(failed.insert(item)),
                    RunEnd::Stopped => stopped = true,
                    _ => {}
                }
                watch(PlanEvent::RunEnded(sweep, item, end));
            }
        });
        let is_complete = queue.into_inner().is_ok_and(|mut queue| queue.next().is_none());
        (!stopped && is_complete).then_some(failed)
    }
}

/// Returns the number of processor cores that this process may use.
pub fn cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Returns the number of runs at a time: at most `jobs`, at most `cores`, and at most `MEMORY_SHARE * free / needed` if each run
/// needs `needed` bytes, but at least one. An unknown value does not limit.
fn fitting(jobs: usize, cores: usize, free: Option<u64>, needed: Option<u64>) -> usize {
    let in_memory = free.zip(needed).map(|(free, needed)| (MEMORY_SHARE * free as f64 / needed as f64) as usize);
    jobs.min(cores).min(in_memory.unwrap_or(usize::MAX)).max(1)
}

fn run_end(output: &Output) -> RunEnd {
    let last = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes).into_owned();
        text.lines().map(str::trim).rfind(|line| !line.is_empty()).map(str::to_owned)
    };
    let reason = last(&output.stderr).unwrap_or_else(|| output.status.to_string());
    match output.status.code() {
        Some(0) => RunEnd::Finished(last(&output.stdout).unwrap_or_default()),
        Some(STOPPED) => RunEnd::Stopped,
        _ => RunEnd::Failed(reason.strip_prefix("error: ").unwrap_or(&reason).to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_and_memory_limit_jobs() {
        let gib = |n: u64| Some(n << 30);
        for (jobs, cores, free, needed, expected) in [
            (8, 4, None, None, 4),
            (2, 4, gib(16), gib(1), 2),
            (8, 8, gib(10), gib(2), 4),
            (8, 8, gib(1), gib(2), 1),
            (8, 8, gib(1), None, 8),
        ] {
            assert_eq!(fitting(jobs, cores, free, needed), expected);
        }
    }
}
