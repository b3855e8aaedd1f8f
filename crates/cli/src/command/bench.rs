//! `infonerf bench`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::Args;
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

/// Measure speed and exactness: time against error, what skipping saves, the cost of a step, agreement of devices.
#[derive(Debug, Args)]
#[command(after_help = BENCH_EXAMPLES)]
pub(crate) struct BenchArgs {
    /// What to measure
    #[arg(value_enum)]
    name: Benchmark,
    /// Experiment to train; without --scene and --variant on its first scene, and `infonerf` (pareto: all variants)
    #[arg(long, value_name = "NAME|FILE", default_value = "fast-losses")]
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// pareto: training times, one run each
    #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = parse_time, default_value = "5s,10s,20s,40s,60s")]
    budgets: Vec<Duration>,
    /// render: longest sides of the images in pixels
    #[arg(long, value_name = "SIZES", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=8192), default_value = "100,200,400,800")]
    sizes: Vec<u32>,
    /// Steps per run [default: skip as configured, render 300, stress-training 80], or measured after the warm-up [default:
    /// step 50, scale 8, ops 7 repeats]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    steps: Option<u32>,
    /// Steps before the measurement [default: step 50, scale 2]
    #[arg(long, value_name = "N")]
    warmup: Option<u32>,
    /// step: start from the weights and the occupancy grid of a finished run instead of an untrained field
    #[arg(long, value_name = "RUN")]
    from: Option<PathBuf>,
    /// stress-training: seeds per setting [default: 20]
    #[arg(id = "runs_each", long = "seeds", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    seeds: Option<u32>,
    /// stress: rays per kind [default: 55000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..))]
    rays: Option<u32>,
    /// Folder for results
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    out: PathBuf,
}

pub(crate) fn run(args: &BenchArgs) -> Result<ExitCode> {
    let options = Options {
        benchmark: args.name,
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
    let holds = infonerf_bench::run(&options, &mut |text| outln!("{text}"))?;
    Ok(if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
