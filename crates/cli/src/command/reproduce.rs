//! `infonerf reproduce`: every table and figure of the paper at a small scale, and whether what it says holds here.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::DeviceName;
use infonerf_experiment::launch::Workers;
use infonerf_experiment::reproduce::{EXPERIMENTS, sweeps, write};
use infonerf_experiment::sweep::{Execution, Prepared, Sweep};
use infonerf_report::ReportInput;

use super::INTERRUPTED;
use super::collect::save_command;
use super::exp::print_claims;
use super::launch::{LaunchArgs, Mode, print};
use super::sweep::{FAILED, announce, execute, merge_one};
use crate::args::SelectionArgs;
use crate::interrupt;
use crate::terminal::open_device;

pub(crate) const REPRODUCE_EXAMPLES: &str = "\
Examples:
  infonerf reproduce
      on the built-in scenes and captures; needs no data
  infonerf reproduce --jobs 2
      two runs at a time, with the same numbers
  infonerf reproduce --data nerf_synthetic --scene lego --only baseline --set scene.size=100
      the table of narrow and wide baselines on real Blender data
  infonerf reproduce --data nerf_llff_data --only llff-2view
      captures alone on real ones: otherwise --data and --scene are of the synthetic experiments, and captures built in
The same command again goes on where it was interrupted.";

#[derive(Debug, Args)]
pub(crate) struct ReproduceArgs {
    /// Only this experiment, again for more.
    #[arg(long, value_name = "EXPERIMENT", value_parser = EXPERIMENTS)]
    only: Vec<String>,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Folder for results, which go into its folder `reproduce`.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

pub(crate) fn run(args: &ReproduceArgs) -> Result<ExitCode> {
    let sweeps = sweeps(&args.only, &args.selection.selection(None))?;
    let device = args.selection.device.device.built_in()?;
    let out = args.out.join("reproduce");
    let prepare = || -> Result<Vec<(&Sweep, Prepared)>> {
        sweeps.iter().map(|sweep| Ok((sweep, sweep.prepare(&out, device)?))).collect()
    };
    let merge = || merge(&sweeps, &out, device);
    match args.launch.mode(device, &args.selection.weights)? {
        Mode::Merge => merge(),
        Mode::Print(runner) => print(&prepare()?, &runner),
        Mode::Submit(scheduler, runner) => args.launch.submit(&prepare()?, &*scheduler, &runner, merge),
        Mode::Local(workers) => {
            let device = open_device(device)?;
            args.selection.weights.networks(&device)?;
            local(prepare()?, &out, &workers, device.name)
        }
    }
}

/// Runs everything on this machine.
fn local(sweeps: Vec<(&Sweep, Prepared)>, out: &Path, workers: &Workers, device: DeviceName) -> Result<ExitCode> {
    interrupt::install()?;
    let (mut inputs, mut all_failed) = (Vec::new(), 0);
    let mut done: Vec<&Sweep> = Vec::new();
    for (sweep, mut prepared) in sweeps {
        println!("\n{}", sweep.about.title);
        announce(sweep, &prepared);
        let adopted = sweep.adopt(&mut prepared, &done, out, device)?;
        if adopted > 0 {
            println!("{adopted} runs are those of experiments above, under other names");
        }
        done.push(sweep);
        save_command(&out.join(&sweep.about.name))?;
        match execute(sweep, &prepared, workers)? {
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
    finish(inputs, all_failed, out)
}

/// Makes every table of what is finished.
fn merge(sweeps: &[Sweep], out: &Path, device: DeviceName) -> Result<ExitCode> {
    let (mut inputs, mut missing) = (Vec::new(), 0);
    for sweep in sweeps {
        println!("\n{}", sweep.about.title);
        let merged = merge_one(sweep, out, device)?;
        missing += merged.missing.len();
        inputs.extend(merged.outcome.map(|outcome| outcome.input));
    }
    finish(inputs, missing, out)
}

/// Writes the report of all, and tells what the paper's statements come to.
fn finish(inputs: Vec<ReportInput>, failed: usize, out: &Path) -> Result<ExitCode> {
    println!();
    inputs.iter().for_each(print_claims);
    println!("\nreport: {}", write(inputs, out)?.display());
    if failed > 0 {
        eprintln!("{failed} runs failed; the same command tries them again");
        return Ok(ExitCode::from(FAILED));
    }
    Ok(ExitCode::SUCCESS)
}
