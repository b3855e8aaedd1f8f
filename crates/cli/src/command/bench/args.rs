use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

use crate::args::{Selection, parse_duration};

pub(crate) const BENCH_EXAMPLES: &str = "\
Examples:
  infonerf bench pareto --budgets 5s,10s,20s,40s,60s
      NeRF and InfoNeRF on a built-in scene: quality against training time
  infonerf bench skip --data nerf_synthetic --scene lego --steps 500
      time, samples and quality with each way of skipping switched off
  infonerf bench step --preset released --set scene.size=100 --steps 3 --warmup 1
      where the time of a step goes
  infonerf bench stress
      errors of every operation against f64 over a million extreme rays a device";

#[derive(Debug, Args)]
pub(crate) struct BenchArgs {
    /// What to measure.
    #[arg(value_enum)]
    pub(crate) name: BenchName,
    /// The experiment that says what is trained; by default on its first scene, and `infonerf` (pareto: all variants).
    #[arg(long, value_name = "NAME|FILE", default_value = "synthetic-4view")]
    pub(crate) experiment: String,
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// pareto: training times, each a run of its own.
    #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = parse_duration, default_value = "5s,10s,20s,40s,60s")]
    pub(crate) budgets: Vec<Duration>,
    /// Steps: of each run (skip: as configured; render: 300; stress-training: 80), or to measure after a warm-up (step: 50;
    /// scale: 8; ops: 15 repeats).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) steps: Option<u32>,
    /// Steps before measuring begins (step: 50; scale: 2).
    #[arg(long, value_name = "N")]
    pub(crate) warmup: Option<u32>,
    /// step: begin with the weights and the occupancy grid that a run left, instead of an untrained field.
    #[arg(long, value_name = "RUN")]
    pub(crate) from: Option<PathBuf>,
    /// stress-training: seeds of each setting (20).
    #[arg(id = "runs_each", long = "seeds", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) seeds: Option<u32>,
    /// stress: rays of each kind (55000).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..))]
    pub(crate) rays: Option<u32>,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    pub(crate) out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BenchName {
    /// Quality against training time, with the frontier.
    Pareto,
    /// What each way of skipping saves, and what it costs in quality.
    Skip,
    /// Milliseconds a step, by phase.
    Step,
    /// How cost grows with rays, samples, resolution and image size.
    Scale,
    /// Seconds a frame by image size.
    Render,
    /// Fused operations against plain tensors.
    Ops,
    /// Errors of every operation and loss on extreme inputs, against f64; fails if a bound is broken.
    Stress,
    /// Tiny runs with settings and scenes that make training diverge or collapse; fails if a number is not finite.
    StressTraining,
}

impl std::fmt::Display for BenchName {
    /// As written on the command line.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let value = self.to_possible_value();
        f.write_str(value.as_ref().map_or("bench", |value| value.get_name()))
    }
}
