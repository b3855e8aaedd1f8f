//! `infonerf sweep`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::{Args, ValueEnum};
use infonerf_experiment::sweep::{PAPER_SPACE, Sweep, SweepOptions};

use crate::launch::{LaunchArgs, drive};
use crate::selection::SelectionArgs;
use crate::units::parse_time;

const SWEEP_EXAMPLES: &str = "\
Examples:
  infonerf sweep synthetic-4view --variant infonerf --grid loss.entropy.weight=0,1e-4,1e-3,1e-2
      one run for each weight and scene
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --grid loss.kl.weight=0,1e-5 --seed 0..4 --jobs 2
      every combination with five seeds, two runs at a time
  infonerf sweep paper-regime --variant infonerf --space paper --seed 0..4
      λ1 × λ2 as a heat map, and whether the best pair is better than its neighbours
  infonerf sweep loss-ablation --variant both --random 20 --range loss.entropy.weight=log:1e-5:1e-1 --halving 3
      twenty random weights; the two thirds that fit the training images worst are stopped early, twice
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --seed 0..4 --launch slurm --timeout 30m --watch
      each run as a task of a Slurm array; runs that need more than 30 minutes are saved and resumed
The same command resumes where it was interrupted.";

/// Run an experiment for every combination of the given values, and tabulate and plot the results.
#[derive(Debug, Args)]
#[command(after_help = SWEEP_EXAMPLES)]
pub(crate) struct SweepArgs {
    /// Built-in experiment (see `infonerf list`) or TOML file
    experiment: String,
    /// Key of the config and its values; may be repeated, for every combination
    #[arg(long = "grid", value_name = "KEY=V1,V2,...", required_unless_present_any = ["random", "space"])]
    grids: Vec<String>,
    /// Predefined grids; `paper`: four values of λ1 times four of λ2
    #[arg(long, value_name = "NAME", hide_possible_values = true)]
    space: Option<ReadySpace>,
    /// Number of random settings, drawn from --range; a larger N keeps those of a smaller one
    #[arg(long, value_name = "N", requires = "ranges", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    random: Option<u32>,
    /// Key of the config and the range that --random draws from: uniform, log-uniform (log:) or whole numbers (int:)
    #[arg(long = "range", value_name = "KEY=[log:|int:]LOW:HIGH", requires = "random")]
    ranges: Vec<String>,
    /// Seed of --random [default: 0]
    #[arg(long, value_name = "N", requires = "random")]
    random_seed: Option<u64>,
    /// Successive halving: after 1/N² and 1/N of each run, for instance, only the 1/N of the settings continue that fit the
    /// training images best; test views are not looked at
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=16))]
    halving: Option<u32>,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Training time per run, such as 60s or 5m; schedules follow the clock
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    budget: Option<Duration>,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Folder for results
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

/// Grids under a name.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ReadySpace {
    /// The paper's two weights.
    Paper,
}

impl ReadySpace {
    fn grids(self) -> Vec<String> {
        match self {
            Self::Paper => PAPER_SPACE.map(str::to_owned).to_vec(),
        }
    }
}

pub(crate) fn run(args: &SweepArgs) -> Result<ExitCode> {
    let options = SweepOptions {
        grids: [args.space.map(ReadySpace::grids).unwrap_or_default(), args.grids.clone()].concat(),
        random: args.random.unwrap_or(0),
        ranges: args.ranges.clone(),
        random_seed: args.random_seed.unwrap_or(0),
        halving: args.halving,
        selection: args.selection.selection(args.budget),
    };
    let sweep = Sweep::plan(&args.experiment, &options)?;
    drive(&[sweep], &args.selection, &args.launch, &args.out, |_| Ok(()))
}
