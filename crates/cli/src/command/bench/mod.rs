//! `infonerf bench`: how fast, what speed costs, and how exact under stress.
//!
//! Each benchmark is one file with one function that measures, prints a table, and writes `results.json` and pictures.

mod args;
mod context;
mod ops;
mod output;
mod pareto;
mod render;
mod scale;
mod skip;
mod step;
mod stress;
mod training;
mod trial;

use std::process::ExitCode;

use anyhow::Result;

use args::BenchName;
pub(crate) use args::{BENCH_EXAMPLES, BenchArgs};
use context::Bench;

pub(crate) fn run(args: &BenchArgs) -> Result<ExitCode> {
    let bench = Bench::new(args)?;
    println!("{bench}");
    let mut holds = true;
    match args.name {
        BenchName::Pareto => pareto::run(&bench, args)?,
        BenchName::Skip => skip::run(&bench, args)?,
        BenchName::Step => step::run(&bench, args)?,
        BenchName::Scale => scale::run(&bench, args)?,
        BenchName::Render => render::run(&bench, args)?,
        BenchName::Ops => ops::run(&bench, args)?,
        BenchName::Stress => holds = stress::run(&bench, args)?,
        BenchName::StressTraining => holds = training::run(&bench, args)?,
    }
    println!("\nresults: {}", bench.folder.display());
    Ok(if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
