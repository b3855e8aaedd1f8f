//! Runs items, each as a process of its own: one that fails takes no other with it.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::mpsc;
use std::thread;

use infonerf_train::available_memory;

use super::Runner;
use super::capacity::{cores, fitting};

/// Says how much memory an item's process took, in MiB, at the start of a line.
pub const PEAK_MEMORY: &str = "peak memory (MiB): ";

/// Exit code of an item's process that was told to stop, and saved.
pub const STOPPED: i32 = 130;

/// How an item's process ended.
#[derive(Clone, Debug)]
pub enum Ended {
    /// With a record, or as far as it was asked to; what it said.
    Finished(String),
    /// Saved, when told to stop.
    Stopped,
    /// Without a record; why.
    Failed(String),
}

/// How items are run on this machine.
#[derive(Clone, Debug)]
pub struct Workers {
    /// The program that runs them.
    pub runner: Runner,
    /// Runs at a time, at most: no more than there are cores, nor than fit into the free memory.
    pub jobs: usize,
    /// Whether no more runs are to be started.
    pub stop: fn() -> bool,
}

/// Items of one manifest.
pub(crate) struct Queue<'a> {
    pub(crate) manifest: &'a Path,
    pub(crate) workers: &'a Workers,
    /// Fraction of each run after which it is stopped, to be resumed later.
    pub(crate) until: Option<f64>,
}

impl Queue<'_> {
    /// Runs `items` in their order and reports each when it ends. Starts no more of them once they are to stop.
    ///
    /// The first of them runs alone, with all cores, if more than one may run at a time and `peak` is not known: it shows
    /// how much memory a run takes.
    pub(crate) fn run(&self, items: Vec<usize>, peak: Option<u64>, mut report: impl FnMut(usize, Ended)) {
        let jobs = (self.workers.jobs).min(items.len());
        let mut peak = peak;
        let mut items = items.into_iter();
        while jobs > 1 && peak.is_none() && available_memory().is_some() && !(self.workers.stop)() {
            let Some(item) = items.next() else { return };
            let (ended, taken) = self.run_one(item, 1);
            peak = taken;
            report(item, ended);
        }
        let jobs = fitting(jobs, cores(), available_memory(), peak);
        let queue = Mutex::new(items);
        let next = || queue.lock().ok().filter(|_| !(self.workers.stop)()).and_then(|mut queue| queue.next());
        thread::scope(|scope| {
            let (sender, receiver) = mpsc::channel();
            for _ in 0..jobs {
                let (sender, next) = (sender.clone(), &next);
                scope.spawn(move || {
                    while let Some(item) = next() {
                        if sender.send((item, self.run_one(item, jobs).0)).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (item, ended) in receiver {
                report(item, ended);
            }
        });
    }

    /// Runs an item beside `jobs - 1` others, and tells how it ended and how many bytes of memory it took.
    fn run_one(&self, item: usize, jobs: usize) -> (Ended, Option<u64>) {
        let output = self.command(item, jobs).spawn().and_then(|mut child| {
            // Held open until the item ends: if this process dies, the item's sees its input end.
            let input = child.stdin.take();
            let output = child.wait_with_output();
            drop(input);
            output
        });
        match output {
            Ok(output) => (ended(&output), peak_memory(&output)),
            Err(error) => (Ended::Failed(error.to_string()), None),
        }
    }

    fn command(&self, item: usize, jobs: usize) -> Command {
        let words = self.workers.runner.command(self.manifest);
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).arg(item.to_string()).arg("--tied");
        if let Some(share) = self.until {
            command.arg("--until").arg(share.to_string());
        }
        if jobs > 1 {
            command.env("RAYON_NUM_THREADS", (cores() / jobs).max(1).to_string());
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }
}

fn ended(output: &Output) -> Ended {
    let last = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes).into_owned();
        text.lines().map(str::trim).rfind(|line| !line.is_empty()).map(str::to_owned)
    };
    if output.status.success() {
        return Ended::Finished(last(&output.stdout).unwrap_or_default());
    }
    if output.status.code() == Some(STOPPED) {
        return Ended::Stopped;
    }
    let reason = last(&output.stderr).unwrap_or_else(|| output.status.to_string());
    Ended::Failed(reason.strip_prefix("error: ").map_or(reason.clone(), str::to_owned))
}

fn peak_memory(output: &Output) -> Option<u64> {
    let text = String::from_utf8_lossy(&output.stdout);
    let mebibytes: u64 = text.lines().find_map(|line| line.strip_prefix(PEAK_MEMORY))?.trim().parse().ok()?;
    Some(mebibytes << 20)
}
