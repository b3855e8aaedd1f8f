use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use infonerf_experiment::{DeviceName, Selection};

/// What to measure, and on what.
#[derive(Clone, Debug)]
pub struct Options {
    /// What to measure.
    pub benchmark: Benchmark,
    /// The experiment that says what is trained: on its first scene, and its variant `infonerf` (pareto: all variants),
    /// unless the selection says otherwise.
    pub experiment: String,
    /// Which of its runs.
    pub selection: Selection,
    /// Where to compute.
    pub device: DeviceName,
    /// Pareto: training times, each a run of its own.
    pub budgets: Vec<Duration>,
    /// Render: longest sides of the images, pixels.
    pub sizes: Vec<u32>,
    /// Steps of each run, or to measure after a warm-up; repeats of an operation.
    pub steps: Option<u32>,
    /// Steps before measuring begins.
    pub warmup: Option<u32>,
    /// Step: begin with the weights and the occupancy grid that a run left, instead of an untrained field.
    pub from: Option<PathBuf>,
    /// Stress training: seeds of each setting.
    pub seeds: Option<u32>,
    /// Stress: rays of each kind.
    pub rays: Option<u32>,
    /// A file or folder of weights of learned metrics, beside the places where they are looked for.
    pub weights: Option<PathBuf>,
    /// Folder for results.
    pub out: PathBuf,
}

/// A benchmark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Benchmark {
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

impl fmt::Display for Benchmark {
    /// As written on the command line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pareto => "pareto",
            Self::Skip => "skip",
            Self::Step => "step",
            Self::Scale => "scale",
            Self::Render => "render",
            Self::Ops => "ops",
            Self::Agreement => "agreement",
            Self::Stress => "stress",
            Self::StressTraining => "stress-training",
        })
    }
}
