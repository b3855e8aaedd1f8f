//! The command line: a list of subcommands, each with its arguments and its body in a file.

mod bench;
mod capture;
mod demo;
mod eval;
mod exp;
mod export;
mod list;
mod pretrain;
mod render;
mod reproduce;
mod results;
mod scene;
mod sweep;
mod sweep_item;
mod view;
mod weights;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

/// Learn a 3D scene from a handful of photographs, and measure how well.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 120)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::DemoArgs),
    Capture(capture::CaptureArgs),
    Exp(exp::ExpArgs),
    Pretrain(pretrain::PretrainArgs),
    Sweep(sweep::SweepArgs),
    #[command(hide = true)]
    SweepItem(sweep_item::SweepItemArgs),
    Reproduce(reproduce::ReproduceArgs),
    Tensorboard(results::TensorboardArgs),
    Bench(bench::BenchArgs),
    Eval(eval::EvalArgs),
    Weights(weights::WeightsArgs),
    Render(render::RenderArgs),
    Export(export::ExportArgs),
    Figure(results::FigureArgs),
    View(view::ViewArgs),
    #[command(subcommand)]
    Scene(scene::SceneCommand),
    List(list::ListArgs),
    Config(list::ConfigArgs),
    Collect(results::CollectArgs),
}

impl Args {
    pub(crate) fn run(&self) -> Result<ExitCode> {
        match &self.command {
            Command::Demo(args) => demo::run(args),
            Command::Capture(args) => capture::run(args),
            Command::Exp(args) => exp::run(args),
            Command::Pretrain(args) => pretrain::run(args),
            Command::Sweep(args) => sweep::run(args),
            Command::SweepItem(args) => sweep_item::run(args),
            Command::Reproduce(args) => reproduce::run(args),
            Command::Tensorboard(args) => results::tensorboard(args),
            Command::Bench(args) => bench::run(args),
            Command::Eval(args) => eval::run(args),
            Command::Weights(args) => weights::run(args),
            Command::Render(args) => render::run(args),
            Command::Export(args) => export::run(args),
            Command::Figure(args) => results::figure(args),
            Command::View(args) => view::run(args),
            Command::Scene(command) => scene::run(command),
            Command::List(args) => list::run(args),
            Command::Config(args) => list::config(args),
            Command::Collect(args) => results::collect(args),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn help_has_no_links_of_rustdoc() {
        fn check(command: &mut clap::Command) {
            let help = command.render_long_help().to_string();
            assert!(!help.contains("[`"), "{}: {help}", command.get_name());
            command.get_subcommands_mut().for_each(check);
        }
        check(&mut Args::command());
    }
}
