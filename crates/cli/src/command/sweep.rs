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
      each run as a task of a Slurm array; a run that 30 minutes do not suffice for saves, and goes on the next time
The same command again goes on where it was interrupted.";

/// Run an experiment for every combination of some values, and tabulate and plot what came of it.
#[derive(Debug, Args)]
#[command(after_help = SWEEP_EXAMPLES)]
pub(crate) struct SweepArgs {
    /// A built-in experiment (see `infonerf list`) or a TOML file.
    experiment: String,
    /// A key of the config and the values that it takes; again for every combination with another key's.
    #[arg(long = "grid", value_name = "KEY=V1,V2,...", required_unless_present_any = ["random", "space"])]
    grids: Vec<String>,
    /// Ready grids: `paper` has four values of each of λ1 and λ2.
    #[arg(long, value_name = "NAME")]
    space: Option<ReadySpace>,
    /// Random settings of the keys of --range: always the same ones, and more of them for a larger N.
    #[arg(long, value_name = "N", requires = "ranges", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    random: Option<u32>,
    /// A key of the config and where --random draws it from: evenly, evenly in its logarithm, or whole numbers.
    #[arg(long = "range", value_name = "KEY=[log:|int:]LOW:HIGH", requires = "random")]
    ranges: Vec<String>,
    /// Other random settings [default: 0]
    #[arg(long, value_name = "N", requires = "random")]
    random_seed: Option<u64>,
    /// Stop hopeless settings early (successive halving): at 1/N² and 1/N of each run, for instance, only the 1/N of
    /// the settings go on that fit the training images best. Test views have no part in it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=16))]
    halving: Option<u32>,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Training time for each run, such as 60s or 5m; the schedule follows the clock.
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    budget: Option<Duration>,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Folder for results.
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
