//! Benchmarks: speed, what speed costs, exactness under stress, and agreement of devices.
//!
//! Each benchmark is one file with one function that measures, prints what it found, and writes `results.json` and a table as
//! CSV. [`run`] runs one of [`Benchmark`].

mod agreement;
mod context;
mod options;
mod output;
mod pareto;
mod published;
mod render;
mod roofline;
mod skip;
mod step;
mod stress;
mod stress_training;
mod trial;
mod values;

use anyhow::Result;

use context::Bench;
pub use options::{BenchOptions, Benchmark};

/// Runs a benchmark; `print` receives its results as text. Returns whether every bound that it checks holds.
///
/// # Errors
/// If the experiment cannot be planned, a run fails, or a file cannot be written.
pub fn run(options: &BenchOptions, print: &mut dyn FnMut(&str)) -> Result<bool> {
    let bench = Bench::new(options)?;
    print(&bench.to_string());
    let holds = match &options.benchmark {
        Benchmark::Pareto { budgets } => pareto::run(&bench, budgets, print).map(|()| true),
        Benchmark::Skip { steps } => skip::run(&bench, *steps, print).map(|()| true),
        Benchmark::Step { warmup, steps, from } => {
            step::run(&bench, [*warmup, *steps], from.as_deref(), print).map(|()| true)
        }
        Benchmark::Render { steps, sizes } => render::run(&bench, *steps, sizes, print).map(|()| true),
        Benchmark::Agreement => agreement::run(&bench, options.device, print),
        Benchmark::Stress { rays } => stress::run(&bench, options.device, *rays as usize, print),
        Benchmark::StressTraining { seeds, steps } => stress_training::run(&bench, *seeds, *steps, print),
    }?;
    print(&format!("\nresults: {}", bench.folder.display()));
    Ok(holds)
}
