use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::args::{DeviceName, Selection, parse_duration};

pub(crate) const SWEEP_EXAMPLES: &str = "\
Examples:
  infonerf sweep synthetic-4view --variant infonerf --grid loss.entropy.weight=0,1e-4,1e-3,1e-2
      one run for each weight and scene
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --grid loss.gain.weight=0,1e-5 --seed 0..4 --jobs 2
      every combination with five seeds, two runs at a time
The same command again goes on where it was interrupted. On a cluster, give each job of an array its number:
  infonerf sweep-item runs/sweep-synthetic-4view/manifest.jsonl $SLURM_ARRAY_TASK_ID";

#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// A built-in experiment (see `infonerf list`) or a TOML file.
    pub(crate) experiment: String,
    /// A key of the config and the values that it takes; again for every combination with another key's.
    #[arg(long = "grid", value_name = "KEY=V1,V2,...", required = true)]
    pub(crate) grids: Vec<String>,
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Training time for each run, such as 60s or 5m; the schedule follows the clock.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) budget: Option<Duration>,
    /// Runs at a time; they share the cores.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) jobs: u32,
    /// Write the manifest and stop: its items are run by `infonerf sweep-item`.
    #[arg(long)]
    pub(crate) manifest_only: bool,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct SweepItemArgs {
    /// The manifest.jsonl of a sweep; results go into its folder.
    pub(crate) manifest: PathBuf,
    /// Which of its items, from 0.
    pub(crate) item: usize,
    /// Where to compute.
    #[arg(long, value_enum, default_value_t = DeviceName::Auto)]
    pub(crate) device: DeviceName,
    /// End when standard input is closed, as it is when the parent process ends.
    #[arg(long, hide = true)]
    pub(crate) tied: bool,
}
