//! `infonerf list`.

use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::print::outln;

/// List the built-in experiments.
#[derive(Debug, Args)]
pub(crate) struct ListArgs {}

pub(crate) fn run() -> Result<ExitCode> {
    for (name, title) in infonerf_experiment::list()? {
        outln!("{name:24} {title}");
    }
    Ok(ExitCode::SUCCESS)
}
