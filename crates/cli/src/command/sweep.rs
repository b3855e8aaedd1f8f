use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::sweep::{PAPER_SPACE, Sweep};

use crate::completion;
use crate::launch::LaunchArgs;
use crate::selection::SelectionArgs;
use crate::units::{parse_folder, parse_time};

const SWEEP_EXAMPLES: &str = "\
Examples:
  infonerf sweep synthetic-4view --variant infonerf --grid loss.entropy.weight=0,1e-4,1e-3,1e-2
      one run for each weight and scene
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --grid loss.kl.weight=0,1e-5 --seed 0..4 --jobs 2
      every combination with five seeds, two runs at a time
  infonerf sweep synthetic-4view --variant infonerf --space paper --seed 0..4
      λ1 × λ2 as a heat map
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --seed 0..4 --launch slurm --timeout 30m --watch
      each run as a task of a Slurm array; runs that need more than 30 minutes are saved and continued
The same command continues where it was interrupted.";

/// Run an experiment for every combination of the given values, and tabulate and plot the results.
#[derive(Debug, Args)]
#[command(after_help = SWEEP_EXAMPLES)]
pub(crate) struct SweepArgs {
    /// Built-in experiment (see `infonerf list`) or TOML file
    #[arg(add = completion::experiments())]
    experiment: String,
    /// Key of the config and its values; may be repeated, for every combination
    #[arg(long = "grid", value_name = "KEY=V1,V2,...", add = completion::keys(), required_unless_present = "space")]
    grids: Vec<String>,
    /// Predefined grids; `paper`: four values of λ1 times four of λ2
    #[arg(long, value_name = "NAME", value_parser = ["paper"], hide_possible_values = true)]
    space: Option<String>,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Training time per run, such as 60s or 5m; schedules follow the clock
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    budget: Option<Duration>,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Folder for results
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs")]
    out: PathBuf,
}

pub(crate) fn run(args: &SweepArgs) -> Result<ExitCode> {
    let space = args.space.iter().flat_map(|_| PAPER_SPACE).map(str::to_owned);
    let grids: Vec<String> = space.chain(args.grids.iter().cloned()).collect();
    let sweep = Sweep::plan(&args.experiment, &grids, &args.selection.selection(args.budget))?;
    args.launch.run(vec![sweep], &args.selection, &args.out, |_| Ok(()))
}
