//! Where runs happen: in processes of this machine, as jobs of a scheduler, or elsewhere by printed commands.

mod drive;
mod jobs;
mod local;

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::Args;
use infonerf_experiment::DeviceName;
use infonerf_experiment::launch::{Launcher, Resources, Runner, Scheduler};

use crate::selection::NetworkArgs;
use crate::units::{parse_mebibytes, parse_time};

pub(crate) use drive::drive;

/// Where runs happen, and how much of it they may take.
#[derive(Clone, Debug, Args)]
pub(crate) struct LaunchArgs {
    /// Runs at a time, each in a process of its own, no more than cores and free memory allow [default: 1; with --launch, as
    /// many as the scheduler starts]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    jobs: Option<u32>,
    /// Give up on a run that takes longer than this, such as 10m, and continue with the others; what was saved is kept
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    timeout: Option<Duration>,
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
    /// Another option of sbatch or hq submit, such as --submit-option=--account=vision; may be repeated
    #[arg(long = "submit-option", value_name = "OPTION", allow_hyphen_values = true, help_heading = "Other machines")]
    submit_options: Vec<String>,
    /// Show the progress of the jobs until they have ended, then the table
    #[arg(long, help_heading = "Other machines")]
    watch: bool,
    /// Run nothing; write the tables and the report of what is finished
    #[arg(long, help_heading = "Other machines")]
    merge: bool,
}

/// Where a command line wants its runs.
enum Place {
    /// In processes of this machine.
    Here,
    /// As jobs.
    Scheduler(Box<dyn Scheduler>),
    /// Elsewhere: their commands are printed.
    Printed,
    /// Nowhere: what is finished is merged.
    Merged,
}

impl LaunchArgs {
    /// Whether runs need no process of their own.
    ///
    /// # Errors
    /// If the options do not go together.
    pub(crate) fn in_process(&self) -> Result<bool> {
        Ok(matches!(self.place()?, Place::Here) && self.limit().is_none())
    }

    /// The first of the options without which a local run needs no process of its own.
    pub(crate) fn limit(&self) -> Option<&'static str> {
        let given = [("--jobs", self.jobs.is_some()), ("--timeout", self.timeout.is_some())];
        given.into_iter().find_map(|(option, given)| given.then_some(option))
    }

    fn place(&self) -> Result<Place> {
        if self.merge {
            return Ok(Place::Merged);
        }
        let resources = Resources {
            partition: self.partition.clone(),
            memory: self.memory,
            cpus: self.cpus,
            at_once: self.jobs,
            options: self.submit_options.clone(),
        };
        match (self.launch.scheduler(resources)?, self.launch) {
            (Some(scheduler), _) => Ok(Place::Scheduler(scheduler)),
            (None, launch) if self.watch => {
                bail!("--watch: expected --launch slurm or hyperqueue, found --launch {launch}")
            }
            (None, Launcher::Print) => Ok(Place::Printed),
            (None, _) => Ok(Place::Here),
        }
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
