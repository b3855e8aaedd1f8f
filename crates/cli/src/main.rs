//! `infonerf`: few-shot neural radiance fields from the command line.

#![allow(clippy::print_stdout, reason = "a command prints its results")]

mod args;
mod command;
mod interrupt;
mod live;
mod output;
mod progress;
mod terminal;

use std::process::ExitCode;

use clap::Parser;

/// Exit code for anything that the user can put right.
const USER_ERROR: u8 = 2;

fn main() -> ExitCode {
    let args = args::Args::parse();
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| "warn".into());
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time().init();
    match command::run(args.command) {
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
