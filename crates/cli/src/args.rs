//! The command line: a list of subcommands, each with its arguments and its body in a file of `command`.

use std::process::ExitCode;

use anyhow::Result;
use clap::{CommandFactory, Parser, Subcommand};

use crate::command::{
    bench, capture, collect, demo, documentation, eval, exp, export, figure, list, pretrain, render, reproduce, scene,
    sweep, sweep_item, tensorboard, view, weights,
};

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
    Tensorboard(tensorboard::TensorboardArgs),
    Bench(bench::BenchArgs),
    Eval(eval::EvalArgs),
    Weights(weights::WeightsArgs),
    Render(render::RenderArgs),
    Export(export::ExportArgs),
    Figure(figure::FigureArgs),
    View(view::ViewArgs),
    #[command(subcommand)]
    Scene(scene::SceneCommand),
    List(list::ListArgs),
    Config(list::ConfigArgs),
    Collect(collect::CollectArgs),
    Completions(documentation::CompletionsArgs),
    Man(documentation::ManArgs),
}

impl Args {
    /// Runs the subcommand.
    pub(crate) fn run(&self) -> Result<ExitCode> {
        match &self.command {
            Command::Demo(args) => demo::run(args),
            Command::Capture(args) => capture::run(args),
            Command::Exp(args) => exp::run(args),
            Command::Pretrain(args) => pretrain::run(args),
            Command::Sweep(args) => sweep::run(args),
            Command::SweepItem(args) => sweep_item::run(args),
            Command::Reproduce(args) => reproduce::run(args),
            Command::Tensorboard(args) => tensorboard::run(args),
            Command::Bench(args) => bench::run(args),
            Command::Eval(args) => eval::run(args),
            Command::Weights(args) => weights::run(args),
            Command::Render(args) => render::run(args),
            Command::Export(args) => export::run(args),
            Command::Figure(args) => figure::run(args),
            Command::View(args) => view::run(args),
            Command::Scene(command) => scene::run(command),
            Command::List(args) => list::run(args),
            Command::Config(args) => list::config(args),
            Command::Collect(args) => collect::run(args),
            Command::Completions(args) => documentation::completions(args, &mut Self::command()),
            Command::Man(args) => documentation::man(args, Self::command()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
    }
}
