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
  infonerf sweep loss-ablation --variant both --random 20 --range loss.entropy.weight=log:1e-5:1e-1 --halving 3
      twenty random weights; the two thirds that fit the training images worst are stopped early, twice
The same command again goes on where it was interrupted. On a cluster, give each job of an array its number:
  infonerf sweep-item runs/sweep-synthetic-4view/manifest.jsonl $SLURM_ARRAY_TASK_ID";

#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// A built-in experiment (see `infonerf list`) or a TOML file.
    pub(crate) experiment: String,
    /// A key of the config and the values that it takes; again for every combination with another key's.
    #[arg(long = "grid", value_name = "KEY=V1,V2,...", required_unless_present = "random")]
    pub(crate) grids: Vec<String>,
    /// Random settings of the keys of --range: always the same ones, and more of them for a larger N.
    #[arg(long, value_name = "N", requires = "ranges", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) random: Option<u32>,
    /// A key of the config and where --random draws it from: evenly, evenly in its logarithm, or whole numbers.
    #[arg(long = "range", value_name = "KEY=[log:|int:]LOW:HIGH", requires = "random")]
    pub(crate) ranges: Vec<String>,
    /// Other random settings [default: 0]
    #[arg(long, value_name = "N", requires = "random")]
    pub(crate) random_seed: Option<u64>,
    /// Stop hopeless settings early (successive halving): at 1/N² and 1/N of each run, for instance, only the 1/N of
    /// the settings go on that fit the training images best. Test views have no part in it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=16), conflicts_with = "manifest_only")]
    pub(crate) halving: Option<u32>,
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Training time for each run, such as 60s or 5m; the schedule follows the clock.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) budget: Option<Duration>,
    #[command(flatten)]
    pub(crate) limits: Limits,
    /// Write the manifest and stop: its items are run by `infonerf sweep-item`.
    #[arg(long)]
    pub(crate) manifest_only: bool,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub(crate) out: PathBuf,
}

/// How much of the machine runs may take.
#[derive(Clone, Debug, Args)]
pub(crate) struct Limits {
    /// Runs at a time, at most: no more than there are cores, nor than fit into the free memory.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) jobs: u32,
    /// Give up on a run that takes longer than this, such as 10m, and go on with the others.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) timeout: Option<Duration>,
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
    /// Stop after this share of the run, such as 0.25, saved to go on later.
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    pub(crate) until: Option<f64>,
    /// Give up after this time, such as 10m; what was saved stays.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) timeout: Option<Duration>,
    /// End when standard input is closed, as it is when the parent process ends.
    #[arg(long, hide = true)]
    pub(crate) tied: bool,
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share = text.parse::<f64>().ok().filter(|share| *share > 0.0 && *share < 1.0);
    share.ok_or_else(|| format!("expected a number above 0 and below 1, found `{text}`"))
}
