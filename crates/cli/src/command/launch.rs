//! `--launch`: runs as jobs on other machines.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::DeviceName;
use infonerf_experiment::launch::{
    Batch, Launched, Launcher, Live, Resources, Runner, Scheduler, Workers, commands, submit,
};
use infonerf_experiment::sweep::{Prepared, Sweep};

use super::INTERRUPTED;
use super::sweep::announce;
use crate::args::{WeightsArgs, parse_duration};
use crate::interrupt;

/// Time between two questions to the scheduler.
const PATIENCE: Duration = Duration::from_secs(5);

/// Where runs happen, and how much of it they may take.
#[derive(Clone, Debug, Args)]
pub(crate) struct LaunchArgs {
    /// Runs at a time, at most, each in a process of its own [default: 1 locally, where no more run than there are cores,
    /// nor than fit into the free memory; as many as the scheduler starts elsewhere]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    jobs: Option<u32>,
    /// Give up on a run that takes longer than this, such as 10m, and go on with the others; what was saved is kept.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    timeout: Option<Duration>,
    /// Where runs happen: local; slurm or hyperqueue, as jobs that share the folder for results; print, nowhere: a command
    /// for each run is printed, for any other scheduler.
    #[arg(long, value_name = "LAUNCHER", default_value_t = Launcher::Local, help_heading = "Other machines")]
    launch: Launcher,
    /// Slurm's partition.
    #[arg(long, value_name = "NAME", help_heading = "Other machines")]
    partition: Option<String>,
    /// Memory of each run, such as 8G.
    #[arg(long, value_name = "SIZE", value_parser = parse_memory, help_heading = "Other machines")]
    memory: Option<u64>,
    /// Processor cores of each run.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096), help_heading = "Other machines")]
    cpus: Option<u32>,
    /// Another option of sbatch or hq submit, such as --submit-option=--account=vision; again for more.
    #[arg(long = "submit-option", value_name = "OPTION", allow_hyphen_values = true, help_heading = "Other machines")]
    submit_options: Vec<String>,
    /// Show the progress of the jobs until they have ended, then the table.
    #[arg(long, help_heading = "Other machines")]
    watch: bool,
    /// Run nothing and make tables and report of what is finished, whatever --launch says.
    #[arg(long, help_heading = "Other machines")]
    merge: bool,
}

/// What a command line asks for.
pub(super) enum Mode {
    /// To run here.
    Local(Workers),
    /// To submit.
    Submit(Box<dyn Scheduler>, Runner),
    /// To print commands.
    Print(Runner),
    /// To merge.
    Merge,
}

impl LaunchArgs {
    /// What to do with runs on `device`.
    pub(super) fn mode(&self, device: DeviceName, weights: &WeightsArgs) -> Result<Mode> {
        if self.merge {
            return Ok(Mode::Merge);
        }
        let absolute = |path: &Path| std::path::absolute(path).with_context(|| path.display().to_string());
        let runner = Runner {
            program: std::env::current_exe().context("the program's own file")?,
            device,
            weights: weights.weights.as_deref().map(absolute).transpose()?,
            timeout: self.timeout,
        };
        let resources = Resources {
            partition: self.partition.clone(),
            memory: self.memory,
            cpus: self.cpus,
            at_once: self.jobs,
            options: self.submit_options.clone(),
        };
        match (self.launch.scheduler(resources)?, self.launch) {
            (Some(scheduler), _) => Ok(Mode::Submit(scheduler, runner)),
            (None, launch) if self.watch => {
                bail!("--watch: expected --launch slurm or hyperqueue, found --launch {launch}")
            }
            (None, Launcher::Print) => Ok(Mode::Print(runner)),
            (None, _) => {
                let jobs = self.jobs.unwrap_or(1) as usize;
                Ok(Mode::Local(Workers { runner, jobs, stop: interrupt::asked }))
            }
        }
    }

    /// The first option given that only runs in processes of their own can obey.
    pub(super) fn limit(&self) -> Option<&'static str> {
        let given = [("--jobs", self.jobs.is_some()), ("--timeout", self.timeout.is_some())];
        given.into_iter().find_map(|(option, given)| given.then_some(option))
    }

    /// Submits what is not finished of `sweeps`, and merges: a job does, or `merge` once the jobs have ended.
    pub(super) fn submit(
        &self,
        sweeps: &[(&Sweep, Prepared)],
        scheduler: &dyn Scheduler,
        runner: &Runner,
        merge: impl FnOnce() -> Result<ExitCode>,
    ) -> Result<ExitCode> {
        for (sweep, prepared) in sweeps {
            announce(sweep, prepared);
        }
        let batches = batches(sweeps)?;
        if batches.is_empty() {
            return merge();
        }
        let launched = submit(batches, scheduler, runner, &merge_command()?)?;
        println!("{} runs submitted as {} {}", launched.items(), self.launch, launched.jobs.join(", "));
        if self.watch {
            return match watch(&launched, scheduler)? {
                true => merge(),
                false => {
                    println!("the jobs go on without this; `{}` ends them", scheduler.cancel(&launched.jobs));
                    Ok(ExitCode::from(INTERRUPTED))
                }
            };
        }
        match launched.merges {
            true => println!("the last of them merges; the same command with --merge does so before"),
            false => println!("the same command with --merge makes the table"),
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Prints a command for each run of `sweeps` that is not finished, and nothing else.
pub(super) fn print(sweeps: &[(&Sweep, Prepared)], runner: &Runner) -> Result<ExitCode> {
    for batch in batches(sweeps)? {
        for command in commands(&batch, runner)? {
            println!("{command}");
        }
    }
    eprintln!("a command for each run that is not finished; then the same command with --merge makes the table");
    Ok(ExitCode::SUCCESS)
}

/// What is not finished of `sweeps`.
fn batches(sweeps: &[(&Sweep, Prepared)]) -> Result<Vec<Batch>> {
    let batches = sweeps.iter().map(|(sweep, prepared)| sweep.batch(prepared)).collect::<Result<Vec<_>>>()?;
    Ok(batches.into_iter().filter(|batch| !batch.items.is_empty()).collect())
}

/// This command, to merge.
fn merge_command() -> Result<Vec<OsString>> {
    let program = std::env::current_exe().context("the program's own file")?;
    let given = std::env::args_os().skip(1);
    Ok(std::iter::once(program.into_os_string()).chain(given).chain(["--merge".into()]).collect())
}

/// Shows how far jobs are until they have ended; false if the user wants to see no more of it.
fn watch(launched: &Launched, scheduler: &dyn Scheduler) -> Result<bool> {
    interrupt::install()?;
    let style = ProgressStyle::with_template("{wide_bar} {pos}/{len} runs, {msg} {elapsed}")?;
    let bar = ProgressBar::new(launched.items() as u64).with_style(style);
    loop {
        let progress = launched.progress(scheduler)?;
        let Live { waiting, running } = progress.live;
        bar.set_position(progress.finished as u64);
        bar.set_message(format!("{waiting} tasks wait, {running} run"));
        if waiting + running == 0 {
            bar.finish_and_clear();
            return Ok(true);
        }
        for _ in 0..PATIENCE.as_millis() / 100 {
            if interrupt::asked() {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

/// `8G`, `500M`, or mebibytes without a unit; in mebibytes.
fn parse_memory(text: &str) -> Result<u64, String> {
    let fault = || format!("expected a size such as 8G or 500M, found `{text}`");
    let (number, scale) = match text.split_at_checked(text.len().saturating_sub(1)) {
        Some((number, "M")) => (number, 1),
        Some((number, "G")) => (number, 1 << 10),
        Some((number, "T")) => (number, 1 << 20),
        _ => (text, 1),
    };
    let size = number.parse::<u64>().ok().and_then(|number| number.checked_mul(scale));
    size.filter(|size| *size > 0).ok_or_else(fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        for (text, mebibytes) in [("8G", 8192), ("500M", 500), ("1T", 1 << 20), ("64", 64)] {
            assert_eq!(parse_memory(text), Ok(mebibytes), "{text}");
        }
        for text in
            ["", "G", "0", "0G", "-1G", "1.5G", "8GB", "many", "99999999999999999999G", "9999999999999999999T", "é"]
        {
            assert!(parse_memory(text).is_err(), "{text}");
        }
    }
}
