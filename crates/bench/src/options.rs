use std::path::PathBuf;
use std::time::Duration;

use infonerf_experiment::{DeviceName, Selection};

/// Benchmark to run, with the runs that it measures.
#[derive(Clone, Debug)]
pub struct BenchOptions {
    /// Benchmark with its own options.
    pub benchmark: Benchmark,
    /// Experiment whose first scene and variant `infonerf` (pareto: all variants) are trained, unless `selection` names others.
    pub experiment: String,
    /// Selected runs of the experiment, and changes of their config.
    pub selection: Selection,
    /// Device to measure.
    pub device: DeviceName,
    /// File or folder of weights of learned metrics, in addition to the usual places.
    pub weights: Option<PathBuf>,
    /// Folder of results.
    pub out: PathBuf,
}

/// Benchmark with its options.
#[derive(Clone, Debug)]
pub enum Benchmark {
    /// Quality against training time, with the frontier.
    Pareto {
        /// Training times, each an independent run.
        budgets: Vec<Duration>,
    },
    /// Time, samples and quality with each way of skipping switched off.
    Skip {
        /// Steps of each run; `None` as configured.
        steps: Option<u32>,
    },
    /// Milliseconds per step, by phase.
    Step {
        /// Steps before the measurement.
        warmup: u32,
        /// Steps measured.
        steps: u32,
        /// Run whose weights and occupancy grid to start from; `None` for an untrained field.
        from: Option<PathBuf>,
    },
    /// Seconds per frame, by image size.
    Render {
        /// Steps of training before rendering.
        steps: u32,
        /// Longest sides of the images, pixels.
        sizes: Vec<u32>,
    },
    /// Agreement of a device with flex: operations, gradients and training steps; fails if a bound is broken.
    Agreement,
    /// Errors of every operation and loss on extreme inputs, against f64; fails if a bound is broken.
    Stress {
        /// Rays of each kind.
        rays: u32,
    },
    /// Tiny runs with settings and scenes that make training diverge or collapse; fails if a value is not finite.
    StressTraining {
        /// Seeds of each setting.
        seeds: u32,
        /// Steps of each run.
        steps: u32,
    },
}

impl Benchmark {
    /// Returns the name on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pareto { .. } => "pareto",
            Self::Skip { .. } => "skip",
            Self::Step { .. } => "step",
            Self::Render { .. } => "render",
            Self::Agreement => "agreement",
            Self::Stress { .. } => "stress",
            Self::StressTraining { .. } => "stress-training",
        }
    }
}
