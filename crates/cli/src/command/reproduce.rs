//! `infonerf reproduce`: every synthetic table and figure of the paper, and whether what it says holds here.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::reproduce::{EXPERIMENTS, sweeps, write};
use infonerf_experiment::sweep::Execution;

use super::INTERRUPTED;
use super::exp::print_claims;
use super::sweep::{FAILED, Limits, announce, execute};
use crate::args::SelectionArgs;
use crate::interrupt;
use crate::terminal::open_device;

pub(crate) const REPRODUCE_EXAMPLES: &str = "\
Examples:
  infonerf reproduce
      on the built-in scenes; needs no data
  infonerf reproduce --jobs 2
      two runs at a time, with the same numbers
  infonerf reproduce --data nerf_synthetic --scene lego --only baseline --set scene.size=100
      the table of narrow and wide baselines on real Blender data
The same command again goes on where it was interrupted.";

#[derive(Debug, Args)]
pub(crate) struct ReproduceArgs {
    /// Only this experiment, again for more.
    #[arg(long, value_name = "EXPERIMENT", value_parser = EXPERIMENTS)]
    only: Vec<String>,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    limits: Limits,
    /// Folder for results, which go into its folder `reproduce`.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

pub(crate) fn run(args: &ReproduceArgs) -> Result<ExitCode> {
    let sweeps = sweeps(&args.only, &args.selection.selection(None))?;
    let device = open_device(args.selection.device.device)?;
    args.selection.weights.networks(&device)?;
    let out = args.out.join("reproduce");
    let prepared = sweeps.iter().map(|sweep| sweep.prepare(&out, device.name.name())).collect::<Result<Vec<_>>>()?;
    interrupt::install()?;
    let workers = args.limits.workers(device.name, &args.selection.weights)?;
    let (mut inputs, mut all_failed) = (Vec::new(), 0);
    for (sweep, prepared) in sweeps.iter().zip(&prepared) {
        println!("\n{}", sweep.about.title);
        announce(sweep, prepared);
        match execute(sweep, prepared, &workers)? {
            Execution::Stopped => {
                println!("stopped and saved; the same command goes on");
                return Ok(ExitCode::from(INTERRUPTED));
            }
            Execution::Ended { failed, outcome } => {
                all_failed += failed;
                inputs.extend(outcome.map(|outcome| outcome.input));
            }
        }
    }
    println!();
    inputs.iter().for_each(print_claims);
    println!("\nreport: {}", write(inputs, &out)?.display());
    if all_failed > 0 {
        eprintln!("{all_failed} runs failed; the same command tries them again");
        return Ok(ExitCode::from(FAILED));
    }
    Ok(ExitCode::SUCCESS)
}
