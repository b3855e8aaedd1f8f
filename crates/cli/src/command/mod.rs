//! One file for each subcommand.

pub(crate) mod bench;
mod collect;
mod demo;
mod documentation;
mod eval;
mod exp;
mod export;
pub(crate) mod launch;
mod pretrain;
mod render;
pub(crate) mod reproduce;
mod scene;
pub(crate) mod sweep;
pub(crate) mod tensorboard;
pub(crate) mod view;
mod weights;

use std::process::ExitCode;

use anyhow::Result;

use crate::args::Command;

/// Exit code after Ctrl-C.
const INTERRUPTED: u8 = 130;

/// Runs a subcommand.
pub(crate) fn run(command: Command) -> Result<ExitCode> {
    match command {
        Command::Demo(args) => demo::run(&args),
        Command::Exp(args) => exp::run(&args),
        Command::Pretrain(args) => pretrain::run(&args),
        Command::Sweep(args) => sweep::run(&args),
        Command::SweepItem(args) => sweep::run_item(&args),
        Command::Reproduce(args) => reproduce::run(&args),
        Command::Tensorboard(args) => tensorboard::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Weights(args) => weights::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Export(args) => export::run(&args),
        Command::View(args) => view::run(&args),
        Command::Scene(command) => scene::run(&command),
        Command::List => {
            for (name, title) in infonerf_experiment::list()? {
                println!("{name:24} {title}");
            }
            Ok(ExitCode::SUCCESS)
        }
        Command::Collect(args) => collect::run(&args),
        Command::Completions { shell } => documentation::completions(shell),
        Command::Man { out } => documentation::man(&out),
    }
}
