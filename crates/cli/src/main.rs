//! `infonerf`: few-shot neural radiance fields from the command line.

#![allow(clippy::print_stdout, reason = "a command prints its results")]

mod args;
mod command;
mod command_line;
mod exit;
mod interrupt;
mod launch;
mod live;
mod output;
mod progress;
mod selection;
mod summary;
mod terminal;
mod units;

use std::process::ExitCode;

use clap::Parser;

use exit::USER_ERROR;

fn main() -> ExitCode {
    let args = args::Args::parse();
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| "warn".into());
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time().init();
    match args.run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {}", one_line(&error));
            ExitCode::from(USER_ERROR)
        }
    }
}

/// An error with its causes on one line.
fn one_line(error: &anyhow::Error) -> String {
    let text = format!("{error:#}");
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ")
}
