use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::{Args, Subcommand};
use infonerf_bench::{Bench, agreement, pareto, render, skip, step, stress, stress_training};
use infonerf_experiment::{RunEvent, Selection};

use crate::completion;
use crate::print::outln;
use crate::progress::ProgressDisplay;
use crate::selection::{DeviceArgs, SelectionArgs};
use crate::units::{parse_folder, parse_time};

const BENCH_EXAMPLES: &str = "\
Examples:
  infonerf bench pareto --budgets 5s,10s,20s,40s,60s
      every variant of fast-losses on a built-in scene: quality against training time
  infonerf bench skip --data nerf_synthetic --scene lego --steps 500
      time, samples and quality with each way of skipping switched off
  infonerf bench step --preset released --set scene.size=100 --steps 3 --warmup 1
      where the time of a step goes
  infonerf bench agreement --device cuda
      whether a GPU computes the same as the CPU
  infonerf bench stress
      errors of every operation against f64 over a million extreme rays per device";

/// Measure speed and exactness: time against error, what skipping saves, the cost of a step, agreement of devices.
#[derive(Debug, Args)]
#[command(after_help = BENCH_EXAMPLES)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    command: BenchCommand,
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    /// Quality against training time, with the frontier
    Pareto {
        /// Training times, one run each
        #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = parse_time, default_value = "5s,10s,20s,40s,60s")]
        budgets: Vec<Duration>,
        #[command(flatten)]
        runs: BenchRuns,
    },
    /// Time, samples and quality with each way of skipping switched off
    Skip {
        /// Steps per run [default: as configured]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        steps: Option<u32>,
        #[command(flatten)]
        runs: BenchRuns,
    },
    /// Milliseconds per training step, by phase
    Step {
        /// Steps measured
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_t = 50)]
        steps: u32,
        /// Steps before the measurement
        #[arg(long, value_name = "N", default_value_t = 50)]
        warmup: u32,
        #[command(flatten)]
        runs: BenchRuns,
    },
    /// Seconds per frame, by image size
    Render {
        /// Steps of training before rendering
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_t = 300)]
        steps: u32,
        /// Longest sides of the images in pixels
        #[arg(long, value_name = "SIZES", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=8192), default_value = "100,200,400,800")]
        sizes: Vec<u32>,
        #[command(flatten)]
        runs: BenchRuns,
    },
    /// Agreement of a device with flex: operations, gradients and training steps; fails if a bound is broken
    Agreement {
        #[command(flatten)]
        device: DeviceArgs,
        /// Folder for results
        #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs/bench")]
        out: PathBuf,
    },
    /// Errors of every operation and loss on extreme inputs, against f64; fails if a bound is broken
    Stress {
        /// Rays per kind
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..), default_value_t = 55_000)]
        rays: u32,
        #[command(flatten)]
        device: DeviceArgs,
        /// Folder for results
        #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs/bench")]
        out: PathBuf,
    },
    /// Tiny runs with settings and scenes that make training diverge or collapse; fails if a value is not finite
    StressTraining {
        /// Seeds per setting
        #[arg(id = "runs_each", long = "seeds", value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_t = 20)]
        seeds: u32,
        /// Steps per run
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_t = 80)]
        steps: u32,
        #[command(flatten)]
        runs: BenchRuns,
    },
}

/// Runs to measure, and the folder of results.
#[derive(Clone, Debug, Args)]
struct BenchRuns {
    /// Experiment to train; by default its first scene and variant `infonerf` (pareto: all variants)
    #[arg(long, value_name = "NAME|FILE", add = completion::experiments(), default_value = "fast-losses")]
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Folder for results
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs/bench")]
    out: PathBuf,
}

/// Variant that benchmarks measure by default.
const VARIANT: Option<&str> = Some("infonerf");

impl BenchRuns {
    fn bench(&self, name: &'static str, variant: Option<&str>) -> Result<Bench> {
        let selection = self.selection.selection(None);
        Bench::new(name, &self.experiment, selection, variant, self.selection.device.device, &self.out)
    }
}

/// Prepares a benchmark of a device, which needs no choice of runs.
fn of_device(name: &'static str, device: DeviceArgs, out: &Path) -> Result<Bench> {
    Bench::new(name, "fast-losses", Selection::default(), VARIANT, device.device, out)
}

/// Runs a benchmark. The exit code is a failure if one of its bounds does not hold.
pub(crate) fn run(args: &BenchArgs) -> Result<ExitCode> {
    let print = &mut |text: &str| outln!("{text}");
    let mut progress = ProgressDisplay::new("bench");
    let watch = &mut |event: RunEvent<'_>| progress.watch(event);
    let holds = match &args.command {
        BenchCommand::Pareto { budgets, runs } => {
            let bench = runs.bench("pareto", None)?.with_networks(runs.selection.networks.weights.as_deref())?;
            pareto(&bench, budgets, print, watch).map(|()| true)
        }
        BenchCommand::Skip { steps, runs } => {
            let bench = runs.bench("skip", VARIANT)?.with_networks(runs.selection.networks.weights.as_deref())?;
            skip(&bench, *steps, print, watch).map(|()| true)
        }
        BenchCommand::Step { steps, warmup, runs } => {
            step(&runs.bench("step", VARIANT)?, [*warmup, *steps], print).map(|()| true)
        }
        BenchCommand::Render { steps, sizes, runs } => {
            render(&runs.bench("render", VARIANT)?, *steps, sizes, print, watch).map(|()| true)
        }
        BenchCommand::Agreement { device, out } => {
            agreement(&of_device("agreement", *device, out)?, device.device, print)
        }
        BenchCommand::Stress { rays, device, out } => {
            stress(&of_device("stress", *device, out)?, device.device, *rays as usize, print)
        }
        BenchCommand::StressTraining { seeds, steps, runs } => {
            stress_training(&runs.bench("stress-training", VARIANT)?, *seeds, *steps, print)
        }
    };
    Ok(if holds? { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
