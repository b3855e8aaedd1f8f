//! What shells and `man` are told of the command line.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::CommandFactory;
use clap_complete::Shell;

use crate::args::Args;

/// Prints the completions of `shell`.
pub(super) fn completions(shell: Shell) -> Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Args::command(), "infonerf", &mut script);
    std::io::stdout().write_all(&script).context("standard output")?;
    Ok(ExitCode::SUCCESS)
}

/// Writes `infonerf.1` and a page for each subcommand into `out`.
pub(super) fn man(out: &Path) -> Result<ExitCode> {
    let named = || out.display().to_string();
    std::fs::create_dir_all(out).with_context(named)?;
    clap_mangen::generate_to(Args::command(), out).with_context(named)?;
    println!("manual pages: {}", out.display());
    Ok(ExitCode::SUCCESS)
}
