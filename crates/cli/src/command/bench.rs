//! `infonerf bench`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::{Args, Subcommand};
use infonerf_bench::{Benchmark, Options};

use crate::print::outln;
use crate::selection::SelectionArgs;
use crate::units::parse_time;

const BENCH_EXAMPLES: &str = "\
Examples:
  infonerf bench pareto --budgets 5s,10s,20s,40s,60s
      every variant of fast-losses on a built-in scene: quality against training time
  infonerf bench skip --data nerf_synthetic --scene lego --steps 500
      time, samples and quality with each way of skipping switched off
  infonerf bench step --preset released --set scene.size=100 --steps 3 --warmup 1
      where the time of a step goes
  infonerf bench agreement --device cuda
      whether a GPU computes what the CPU does
  infonerf bench stress
      errors of every operation against f64 over a million extreme rays per device";

/// Measure speed and exactness
#[derive(Debug, Args)]
#[command(after_help = BENCH_EXAMPLES)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    benchmark: BenchCommand,
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    /// Quality against training time, with the frontier
    Pareto {
        #[command(flatten)]
        common: CommonArgs,
        /// Training times, one run each
        #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = parse_time, default_value = "5s,10s,20s,40s,60s")]
        budgets: Vec<Duration>,
    },
    /// Savings of each way of skipping, and their cost in quality
    Skip {
        #[command(flatten)]
        common: CommonArgs,
        /// Steps per run [default: as configured]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        steps: Option<u32>,
    },
    /// Milliseconds per step, by phase
    Step {
        #[command(flatten)]
        common: CommonArgs,
        /// Steps that are measured [default: 50]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        steps: Option<u32>,
        /// Steps before the measurement [default: 50]
        #[arg(long, value_name = "N")]
        warmup: Option<u32>,
        /// Start from the weights and the occupancy grid of a finished run instead of an untrained field
        #[arg(long, value_name = "RUN")]
        from: Option<PathBuf>,
    },
    /// Seconds per frame by image size
    Render {
        #[command(flatten)]
        common: CommonArgs,
        /// Steps per run [default: 300]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        steps: Option<u32>,
        /// Longest sides of the images in pixels
        #[arg(long, value_name = "SIZES", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=8192), default_value = "100,200,400,800")]
        sizes: Vec<u32>,
    },
    /// A device against flex: operations, gradients and training steps; fails if a bound is exceeded
    Agreement {
        #[command(flatten)]
        common: CommonArgs,
    },
    /// Errors of every operation and loss on extreme inputs, against f64; fails if a bound is exceeded
    Stress {
        #[command(flatten)]
        common: CommonArgs,
        /// Rays per kind [default: 55000]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..))]
        rays: Option<u32>,
    },
    /// Tiny runs with settings and scenes that make training diverge or collapse; fails if a value is not finite
    StressTraining {
        #[command(flatten)]
        common: CommonArgs,
        /// Steps per run [default: 80]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        steps: Option<u32>,
        /// Seeds per setting [default: 20]
        #[arg(id = "runs_each", long = "seeds", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        seeds: Option<u32>,
    },
}

/// The experiment that is trained, and the folder for results.
#[derive(Debug, Args)]
struct CommonArgs {
    /// Experiment to train; without --scene and --variant on its first scene, and `infonerf` (pareto: all variants)
    #[arg(long, value_name = "NAME|FILE", default_value = "fast-losses")]
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Folder for results
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    out: PathBuf,
}

impl CommonArgs {
    fn options(&self, benchmark: Benchmark) -> Options {
        Options {
            benchmark,
            experiment: self.experiment.clone(),
            selection: self.selection.selection(None),
            device: self.selection.device.device,
            budgets: Vec::new(),
            sizes: Vec::new(),
            steps: None,
            warmup: None,
            from: None,
            seeds: None,
            rays: None,
            weights: self.selection.networks.weights.clone(),
            out: self.out.clone(),
        }
    }
}

impl BenchCommand {
    fn options(&self) -> Options {
        match self {
            Self::Pareto { common, budgets } => {
                Options { budgets: budgets.clone(), ..common.options(Benchmark::Pareto) }
            }
            Self::Skip { common, steps } => Options { steps: *steps, ..common.options(Benchmark::Skip) },
            Self::Step { common, steps, warmup, from } => {
                Options { steps: *steps, warmup: *warmup, from: from.clone(), ..common.options(Benchmark::Step) }
            }
            Self::Render { common, steps, sizes } => {
                Options { steps: *steps, sizes: sizes.clone(), ..common.options(Benchmark::Render) }
            }
            Self::Agreement { common } => common.options(Benchmark::Agreement),
            Self::Stress { common, rays } => Options { rays: *rays, ..common.options(Benchmark::Stress) },
            Self::StressTraining { common, steps, seeds } => {
                Options { steps: *steps, seeds: *seeds, ..common.options(Benchmark::StressTraining) }
            }
        }
    }
}

pub(crate) fn run(args: &BenchArgs) -> Result<ExitCode> {
    let holds = infonerf_bench::run(&args.benchmark.options(), &mut |text| outln!("{text}"))?;
    Ok(if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
