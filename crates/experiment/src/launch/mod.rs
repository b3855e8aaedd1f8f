//! Where the items of a manifest run: on this machine, or on others as jobs of a scheduler.
//!
//! A line of the manifest says all that its run needs, and each item is a process of its own that runs or resumes one run
//! below the manifest's folder. That folder is all that machines have to share.
//!
//! ```text
//! manifest.jsonl ─► local: processes of this machine
//!                ├► slurm: array jobs, and a job that merges once they have ended
//!                ├► hyperqueue: task arrays
//!                └► print: a command per item
//! ```

mod array;
mod capacity;
mod command;
mod hyperqueue;
mod jobs;
mod local;
mod print;
mod runner;
mod script;
mod slurm;
mod submit;

use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};

use array::Array;
use hyperqueue::Hyperqueue;
pub(crate) use jobs::refuse_under_way;
pub(crate) use local::Queue;
pub use local::{Ended, PEAK_MEMORY, STOPPED, Workers};
pub use print::commands;
pub use runner::Runner;
use slurm::Slurm;
pub use submit::{Launched, Progress, submit};

/// Where items run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Launcher {
    /// Processes of this machine.
    #[default]
    Local,
    /// Array jobs of Slurm, which share the folder for results.
    Slurm,
    /// Task arrays of HyperQueue, which share the folder for results.
    Hyperqueue,
    /// Nothing: a command per run is printed, for any other scheduler.
    Print,
}

impl Launcher {
    /// As written on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Slurm => "slurm",
            Self::Hyperqueue => "hyperqueue",
            Self::Print => "print",
        }
    }

    /// The scheduler that takes jobs which ask for `resources`; none where items are not run as jobs.
    ///
    /// # Errors
    /// If the launcher does not know one of the resources.
    pub fn scheduler(self, resources: Resources) -> Result<Option<Box<dyn Scheduler>>> {
        if self != Self::Slurm && resources.partition.is_some() {
            bail!("--partition: expected --launch slurm, found --launch {self}");
        }
        match self {
            Self::Slurm => Ok(Some(Box::new(Slurm::new(resources)))),
            Self::Hyperqueue if resources.at_once.is_some() => {
                bail!("--jobs: HyperQueue runs as many items as its workers hold: expected --launch slurm or local")
            }
            Self::Hyperqueue => Ok(Some(Box::new(Hyperqueue::new(resources)))),
            Self::Local | Self::Print => match resources.first_of_a_job() {
                Some(option) => bail!("{option}: expected --launch slurm or hyperqueue, found --launch {self}"),
                None => Ok(None),
            },
        }
    }
}

impl fmt::Display for Launcher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What a job asks its scheduler for. What is `None` is as the scheduler says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resources {
    /// Slurm's partition.
    pub partition: Option<String>,
    /// Memory of each item, in MiB.
    pub memory: Option<u64>,
    /// Processor cores of each item.
    pub cpus: Option<u32>,
    /// Items that run at a time, at most.
    pub at_once: Option<u32>,
    /// Further options of the command that submits, as they are.
    pub options: Vec<String>,
}

impl Resources {
    /// The option of the first resource that only a scheduler can give.
    fn first_of_a_job(&self) -> Option<&'static str> {
        let given = [
            ("--memory", self.memory.is_some()),
            ("--cpus", self.cpus.is_some()),
            ("--submit-option", !self.options.is_empty()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(option, _)| option)
    }
}

/// Items of a manifest that are to run.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Name of its jobs.
    pub name: String,
    /// Folder of the manifest and of the results; absolute.
    pub folder: PathBuf,
    /// The manifest.
    pub manifest: PathBuf,
    /// Which of its items, rising.
    pub items: Vec<usize>,
    /// The file that each of them leaves when it is finished.
    pub records: Vec<PathBuf>,
}

impl Batch {
    /// Folder of the scripts, the logs and the list of jobs.
    pub fn launch_folder(&self) -> PathBuf {
        launch_folder(&self.folder)
    }
}

/// The same of the manifest in `folder`.
fn launch_folder(folder: &Path) -> PathBuf {
    folder.join("launch")
}

/// Takes items as jobs and runs them on other machines.
pub trait Scheduler {
    /// Which one it is.
    fn launcher(&self) -> Launcher;

    /// How many tasks an array may have.
    ///
    /// # Errors
    /// If the scheduler does not answer.
    fn array_limit(&self) -> Result<usize>;

    /// Submits items of `batch` and returns the id of the job. `after` is the job of the array before: where a number of
    /// items at a time is asked for, this one starts when that one has ended.
    ///
    /// # Errors
    /// One line that says what the scheduler said.
    fn submit(&self, batch: &Batch, array: &Array, runner: &Runner, after: Option<&str>) -> Result<String>;

    /// Submits `command`, to start when all of `jobs` have ended, whether they succeeded or failed; returns the id of the
    /// job. None where the scheduler has no such dependency.
    ///
    /// # Errors
    /// As [`Scheduler::submit`].
    fn submit_merge(&self, batch: &Batch, jobs: &[String], command: &[OsString]) -> Result<Option<String>>;

    /// How many tasks of `jobs` have not ended.
    ///
    /// # Errors
    /// If the scheduler does not answer.
    fn live(&self, jobs: &[String]) -> Result<Live>;

    /// What a user types to cancel `jobs`.
    fn cancel(&self, jobs: &[String]) -> String;
}

/// Tasks that have not ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Live {
    /// Tasks that wait.
    pub waiting: usize,
    /// Tasks that run.
    pub running: usize,
}
