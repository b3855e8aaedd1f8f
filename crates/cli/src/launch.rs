//! Execution of the runs of `exp`, `sweep` and `reproduce`, in processes of this machine or as jobs of Slurm.

use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::DeviceName;
use infonerf_experiment::execute::{Executed, Executor, Jobs, Runner, Slurm, Workers, execute};
use infonerf_experiment::sweep::{Sweep, SweepFiles};
use infonerf_report::counted;

use crate::print::outln;
use crate::reporter::Reporter;
use crate::selection::{ExistingArgs, NetworkArgs, SelectionArgs};
use crate::terminal::open_device;
use crate::units::{parse_mebibytes, parse_time};
use crate::{command_line, interrupt};

/// Time between two queries of Slurm.
const PATIENCE: Duration = Duration::from_secs(5);

/// Options with which each run has a process of its own.
pub(crate) const OWN_PROCESSES: [&str; 4] = ["jobs", "timeout", "launch", "merge"];

/// Where runs happen, and how much of it they may take.
#[derive(Clone, Debug, Args)]
pub(crate) struct LaunchArgs {
    /// Runs at a time, each in a process of its own, no more than cores and free memory allow [default: 1; with --launch
    /// slurm, as many as it starts]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    jobs: Option<u32>,
    /// Give up on a run that takes longer than this, such as 10m, and continue with the others; what was saved is kept
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    timeout: Option<Duration>,
    #[command(flatten)]
    pub(crate) existing: ExistingArgs,
    /// Where runs happen
    #[arg(long, value_enum, value_name = "LAUNCHER", default_value_t, help_heading = "Other machines")]
    launch: Launcher,
    /// Slurm's partition
    #[arg(long, value_name = "NAME", help_heading = "Other machines")]
    partition: Option<String>,
    /// Memory per run, such as 8G
    #[arg(long, value_name = "SIZE", value_parser = parse_mebibytes, help_heading = "Other machines")]
    memory: Option<u64>,
    /// Processor cores per run
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096), help_heading = "Other machines")]
    cpus: Option<u32>,
    /// Another option of sbatch, such as --submit-option=--account=vision; may be repeated
    #[arg(long = "submit-option", value_name = "OPTION", allow_hyphen_values = true, help_heading = "Other machines")]
    submit_options: Vec<String>,
    /// Show the progress of the jobs until they have ended, then the table
    #[arg(long, help_heading = "Other machines")]
    watch: bool,
    /// Run nothing; write the tables and the report of what is finished
    #[arg(long, help_heading = "Other machines")]
    merge: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Launcher {
    /// This machine
    #[default]
    Local,
    /// Array jobs of Slurm, which share the folder for results
    Slurm,
}

impl LaunchArgs {
    /// Whether each run has a process of its own; refuses options that do not go together.
    pub(crate) fn own_processes(&self) -> Result<bool> {
        let jobs_alone = [
            ("--partition", self.partition.is_some()),
            ("--memory", self.memory.is_some()),
            ("--cpus", self.cpus.is_some()),
            ("--submit-option", !self.submit_options.is_empty()),
            ("--watch", self.watch),
        ];
        if self.launch == Launcher::Local
            && let Some((option, _)) = jobs_alone.into_iter().find(|(_, given)| *given)
        {
            bail!("{option}: expected --launch slurm");
        }
        Ok(self.merge || self.launch == Launcher::Slurm || self.jobs.is_some() || self.timeout.is_some())
    }

    /// Runs `sweeps` below `out`, each run in a process of its own, prints their tables, and passes what is written to `finish`.
    /// A run that fails is not an error, but changes the exit code.
    pub(crate) fn run(
        &self,
        mut sweeps: Vec<Sweep>,
        selection: &SelectionArgs,
        out: &Path,
        finish: impl FnOnce(Vec<SweepFiles>) -> Result<()>,
    ) -> Result<ExitCode> {
        self.own_processes()?;
        sweeps.iter_mut().for_each(|sweep| sweep.existing = self.existing.existing());
        let device = selection.device.device.built_in()?;
        let executor = if self.merge {
            Executor::Merge(device)
        } else if self.launch == Launcher::Slurm {
            Executor::Slurm(Slurm {
                partition: self.partition.clone(),
                memory: self.memory,
                cpus: self.cpus,
                at_once: self.jobs,
                options: self.submit_options.clone(),
                runner: self.runner(device, &selection.networks)?,
                merge: command_line::merging()?,
            })
        } else {
            // A missing device and broken weights are reported before the runs begin.
            selection.networks.open(&open_device(device)?)?;
            interrupt::install()?;
            let (runner, jobs) = (self.runner(device, &selection.networks)?, self.jobs.unwrap_or(1) as usize);
            Executor::Processes(Workers { runner, jobs, stop: interrupt::stop_requested })
        };
        let again = if self.merge { "the same command without --merge" } else { self.existing.same_command() };
        let mut reporter = Reporter::new(again, device, false, out);
        let mut executed = execute(&sweeps, out, &executor, &mut |event| reporter.watch(event))?;
        if let Executed::Submitted(jobs) = &executed {
            let (runs, ids) = (counted(jobs.records.len(), "run"), jobs.ids.join(", "));
            outln!("{runs} submitted as slurm {ids}; the last of them merges, as the same command with --merge does");
            if !self.watch {
                return Ok(ExitCode::SUCCESS);
            }
            if !watch_jobs(jobs)? {
                outln!("the jobs continue without this; `scancel {}` ends them", jobs.ids.join(" "));
                return Ok(interrupt::exit_code());
            }
            executed = execute(&sweeps, out, &Executor::Merge(device), &mut |event| reporter.watch(event))?;
        }
        let Executed::Ended { unfinished, outcomes } = executed else {
            outln!("stopped and saved; {} continues", self.existing.same_command());
            return Ok(interrupt::exit_code());
        };
        finish(outcomes)?;
        Ok(if unfinished > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS })
    }

    fn runner(&self, device: DeviceName, networks: &NetworkArgs) -> Result<Runner> {
        let absolute = |path: &Path| std::path::absolute(path).with_context(|| path.display().to_string());
        Ok(Runner {
            program: std::env::current_exe().context("the program's own file")?,
            device,
            weights: networks.weights.as_deref().map(absolute).transpose()?,
            timeout: self.timeout,
        })
    }
}

/// Shows the progress of jobs until they have ended. Returns false if the user stopped watching.
fn watch_jobs(jobs: &Jobs) -> Result<bool> {
    interrupt::install()?;
    let style = ProgressStyle::with_template("{wide_bar} {pos}/{len} runs, {msg} {elapsed}")?;
    let bar = ProgressBar::new(jobs.records.len() as u64).with_style(style);
    loop {
        let [finished, waiting, running] = jobs.progress()?;
        bar.set_position(finished as u64);
        bar.set_message(format!("{waiting} tasks wait, {running} run"));
        if waiting + running == 0 {
            bar.finish_and_clear();
            return Ok(true);
        }
        for _ in 0..PATIENCE.as_millis() / 100 {
            if interrupt::stop_requested() {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}
