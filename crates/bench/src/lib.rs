//! Benchmarks: how fast, what speed costs, how exact under stress, and whether devices agree.
//!
//! Each benchmark is one file with one function that measures, says what it found, and writes `results.json` and charts.
//! [`run`] runs one by name.
//!
//! ```no_run
//! use infonerf_bench::{Benchmark, Options, run};
//! use infonerf_experiment::{DeviceName, Selection};
//!
//! // Errors of every operation on extreme inputs, against f64.
//! let options = Options {
//!     benchmark: Benchmark::Stress,
//!     experiment: "synthetic-4view".into(),
//!     selection: Selection::default(),
//!     device: DeviceName::Auto,
//!     budgets: Vec::new(),
//!     sizes: Vec::new(),
//!     steps: None,
//!     warmup: None,
//!     from: None,
//!     seeds: None,
//!     rays: Some(64),
//!     weights: None,
//!     out: "runs/bench".into(),
//! };
//! let holds = run(&options, &mut |line| println!("{line}"))?;
//! assert!(holds);
//! # Ok::<(), anyhow::Error>(())
//! ```

mod agreement;
mod context;
mod ops;
mod options;
mod output;
mod pareto;
mod published;
mod render;
mod roofline;
mod scale;
mod skip;
mod step;
mod stress;
mod training;
mod trial;

use anyhow::Result;

use context::Bench;
pub use options::{Benchmark, Options};

/// Runs a benchmark; `say` is told its results as text. Returns whether everything that it asserts holds.
///
/// # Errors
/// If the experiment cannot be planned, a run fails, or a file cannot be written.
pub fn run(options: &Options, say: &mut dyn FnMut(&str)) -> Result<bool> {
    let bench = Bench::new(options)?;
    say(&bench.to_string());
    let holds = match options.benchmark {
        Benchmark::Pareto => pareto::run(&bench, options, say).map(|()| true),
        Benchmark::Skip => skip::run(&bench, options, say).map(|()| true),
        Benchmark::Step => step::run(&bench, options, say).map(|()| true),
        Benchmark::Scale => scale::run(&bench, options, say).map(|()| true),
        Benchmark::Render => render::run(&bench, options, say).map(|()| true),
        Benchmark::Ops => ops::run(&bench, options, say).map(|()| true),
        Benchmark::Agreement => agreement::run(&bench, options, say),
        Benchmark::Stress => stress::run(&bench, options, say),
        Benchmark::StressTraining => training::run(&bench, options, say),
    }?;
    say(&format!("\nresults: {}", bench.folder.display()));
    Ok(holds)
}
