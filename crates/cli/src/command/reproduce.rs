use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use clap::builder::PossibleValuesParser;
use infonerf_experiment::reproduce::{experiments, sweeps, write};

use crate::launch::LaunchArgs;
use crate::print::outln;
use crate::selection::SelectionArgs;
use crate::units::parse_folder;

const REPRODUCE_EXAMPLES: &str = "\
Examples:
  infonerf reproduce
      on the built-in scenes and captures; needs no data
  infonerf reproduce --jobs 2
      two runs at a time, with the same numbers: an hour on two cores
  infonerf reproduce --full --jobs 2
      four scenes and five view sets for each claim: a night
  infonerf reproduce --data nerf_synthetic --scene lego --only baseline --set scene.size=100
      the table of narrow and wide baselines on real Blender data
  infonerf reproduce --data nerf_llff_data --only llff-2view
      only real captures; with other experiments --data and --scene apply to the synthetic ones alone
The same command continues where it was interrupted.";

/// Reproduce the paper's tables and figures at a small scale in one report, and test its claims.
#[derive(Debug, Args)]
#[command(after_help = REPRODUCE_EXAMPLES)]
pub(crate) struct ReproduceArgs {
    /// Only this experiment; may be repeated
    #[arg(long, value_name = "EXPERIMENT", value_parser = PossibleValuesParser::new(experiments()))]
    only: Vec<String>,
    /// Four scenes and five view sets per claim, instead of what fits into an hour on two cores
    #[arg(long)]
    full: bool,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Folder for results, which go into its subfolder `reproduce`, or `reproduce-full`
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs")]
    out: PathBuf,
}

pub(crate) fn run(args: &ReproduceArgs) -> Result<ExitCode> {
    let sweeps = sweeps(&args.only, args.full, &args.selection.selection(None))?;
    let out = args.out.join(if args.full { "reproduce-full" } else { "reproduce" });
    args.launch.run(sweeps, &args.selection, &out, |outcomes| {
        let inputs: Vec<_> = outcomes.into_iter().map(|outcome| outcome.input).collect();
        outln!("\nreport: {}", write(&inputs, &out)?.display());
        Ok(())
    })
}
