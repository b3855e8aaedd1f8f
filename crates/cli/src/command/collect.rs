//! `infonerf collect`: results of several experiments as one document.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::sweep::collect;
use infonerf_report::{ReportInput, results_document, write_atomically};

use crate::command_line;
use crate::print::outln;

/// Collect the results of experiments and sweeps in one Markdown document.
#[derive(Debug, Args)]
pub(crate) struct CollectArgs {
    /// Folder of an experiment or a sweep, such as runs/synthetic-4view
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Title of the document
    #[arg(long, default_value = "Results")]
    title: String,
    /// File to write
    #[arg(long, value_name = "FILE", default_value = "results.md")]
    out: PathBuf,
}

pub(crate) fn run(args: &CollectArgs) -> Result<ExitCode> {
    let read = |folder: &PathBuf| Ok(ReportInput { command: command_line::read(folder), ..collect(folder)? });
    let experiments = args.folders.iter().map(read).collect::<Result<Vec<_>>>()?;
    write_atomically(&args.out, results_document(&args.title, &experiments).as_bytes())?;
    outln!("{} experiments: {}", experiments.len(), args.out.display());
    Ok(ExitCode::SUCCESS)
}
