//! `infonerf bench`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::{Args, ValueEnum};
use infonerf_bench::{Benchmark, Options};

use crate::selection::SelectionArgs;
use crate::units::parse_time;

const BENCH_EXAMPLES: &str = "\
Examples:
  infonerf bench pareto --budgets 5s,10s,20s,40s,60s
      NeRF and InfoNeRF on a built-in scene: quality against training time
  infonerf bench skip --data nerf_synthetic --scene lego --steps 500
      time, samples and quality with each way of skipping switched off
  infonerf bench step --preset released --set scene.size=100 --steps 3 --warmup 1
      where the time of a step goes
  infonerf bench agreement --device cuda
      whether a GPU computes what the CPU does
  infonerf bench stress
      errors of every operation against f64 over a million extreme rays per device";

/// Measure speed: time against error, what skipping saves, where a step's time goes, how cost grows.
#[derive(Debug, Args)]
#[command(after_help = BENCH_EXAMPLES)]
pub(crate) struct BenchArgs {
    /// What to measure.
    #[arg(value_enum)]
    name: BenchName,
    /// The experiment that says what is trained; by default on its first scene, and `infonerf` (pareto: all variants).
    #[arg(long, value_name = "NAME|FILE", default_value = "fast-losses")]
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// pareto: training times, each a run of its own.
    #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = parse_time, default_value = "5s,10s,20s,40s,60s")]
    budgets: Vec<Duration>,
    /// render: longest sides of the images, pixels.
    #[arg(long, value_name = "SIZES", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=8192), default_value = "100,200,400,800")]
    sizes: Vec<u32>,
    /// Steps: of each run (skip: as configured; render: 300; stress-training: 80), or to measure after a warm-up (step: 50;
    /// scale: 8; ops: 7 repeats).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    steps: Option<u32>,
    /// Steps before measuring begins (step: 50; scale: 2).
    #[arg(long, value_name = "N")]
    warmup: Option<u32>,
    /// step: begin with the weights and the occupancy grid that a run left, instead of an untrained field.
    #[arg(long, value_name = "RUN")]
    from: Option<PathBuf>,
    /// stress-training: seeds of each setting (20).
    #[arg(id = "runs_each", long = "seeds", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    seeds: Option<u32>,
    /// stress: rays of each kind (55000).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..))]
    rays: Option<u32>,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum BenchName {
    /// Quality against training time, with the frontier.
    Pareto,
    /// What each way of skipping saves, and what it costs in quality.
    Skip,
    /// Milliseconds per step, by phase.
    Step,
    /// How cost grows with rays, samples, resolution and image size.
    Scale,
    /// Seconds per frame by image size.
    Render,
    /// Fused operations against plain tensors.
    Ops,
    /// A device against flex: operations, gradients and training steps; fails if a bound is broken.
    Agreement,
    /// Errors of every operation and loss on extreme inputs, against f64; fails if a bound is broken.
    Stress,
    /// Tiny runs with settings and scenes that make training diverge or collapse; fails if a number is not finite.
    StressTraining,
}

impl BenchName {
    fn benchmark(self) -> Benchmark {
        match self {
            Self::Pareto => Benchmark::Pareto,
            Self::Skip => Benchmark::Skip,
            Self::Step => Benchmark::Step,
            Self::Scale => Benchmark::Scale,
            Self::Render => Benchmark::Render,
            Self::Ops => Benchmark::Ops,
            Self::Agreement => Benchmark::Agreement,
            Self::Stress => Benchmark::Stress,
            Self::StressTraining => Benchmark::StressTraining,
        }
    }
}

pub(crate) fn run(args: &BenchArgs) -> Result<ExitCode> {
    let options = Options {
        benchmark: args.name.benchmark(),
        experiment: args.experiment.clone(),
        selection: args.selection.selection(None),
        device: args.selection.device.device,
        budgets: args.budgets.clone(),
        sizes: args.sizes.clone(),
        steps: args.steps,
        warmup: args.warmup,
        from: args.from.clone(),
        seeds: args.seeds,
        rays: args.rays,
        weights: args.selection.networks.weights.clone(),
        out: args.out.clone(),
    };
    let holds = infonerf_bench::run(&options, &mut |text| println!("{text}"))?;
    Ok(if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
