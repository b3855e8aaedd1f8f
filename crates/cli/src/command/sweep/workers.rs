//! Runs items, each as a process of its own: one that fails takes no other with it.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::mpsc;
use std::thread;

use clap::ValueEnum;

use super::INTERRUPTED;
use crate::args::DeviceName;
use crate::interrupt;

/// How items are run.
pub(super) struct Workers<'a> {
    pub(super) manifest: &'a Path,
    /// Processes at a time; they share the cores.
    pub(super) jobs: usize,
    pub(super) device: DeviceName,
}

/// How an item's process ended.
pub(super) enum Ended {
    /// With a record; what it said.
    Finished(String),
    /// Saved, by Ctrl-C.
    Interrupted,
    /// Without a record; why.
    Failed(String),
}

impl Workers<'_> {
    /// Runs `items` in their order and reports each when it ends. Starts no more of them after Ctrl-C.
    pub(super) fn run(&self, items: Vec<usize>, mut report: impl FnMut(usize, Ended)) {
        let jobs = self.jobs.min(items.len());
        let queue = Mutex::new(items.into_iter());
        let next = || queue.lock().ok().filter(|_| !interrupt::asked()).and_then(|mut queue| queue.next());
        thread::scope(|scope| {
            let (sender, receiver) = mpsc::channel();
            for _ in 0..jobs {
                let (sender, next) = (sender.clone(), &next);
                scope.spawn(move || {
                    while let Some(item) = next() {
                        if sender.send((item, self.run_one(item))).is_err() {
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

    fn run_one(&self, item: usize) -> Ended {
        let output = self.command(item).and_then(|mut command| {
            let mut child = command.spawn()?;
            // Held open until the item ends: if this process dies, the item's sees its input end.
            let input = child.stdin.take();
            let output = child.wait_with_output();
            drop(input);
            output
        });
        match output {
            Ok(output) => ended(&output),
            Err(error) => Ended::Failed(error.to_string()),
        }
    }

    fn command(&self, item: usize) -> std::io::Result<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("sweep-item").arg("--tied").arg(self.manifest).arg(item.to_string());
        if let Some(device) = self.device.to_possible_value() {
            command.arg("--device").arg(device.get_name());
        }
        if self.jobs > 1 {
            let cores = thread::available_parallelism().map_or(1, usize::from);
            command.env("RAYON_NUM_THREADS", (cores / self.jobs).max(1).to_string());
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        Ok(command)
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
    if output.status.code() == Some(i32::from(INTERRUPTED)) {
        return Ended::Interrupted;
    }
    let reason = last(&output.stderr).unwrap_or_else(|| output.status.to_string());
    Ended::Failed(reason.strip_prefix("error: ").map_or(reason.clone(), str::to_owned))
}
