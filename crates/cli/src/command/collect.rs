//! `infonerf collect`: results of several experiments as one document.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::Args;
use infonerf_experiment::{About, RunPlan};
use infonerf_report::{ReportInput, read_records, results_document, run_directory, write_atomically};

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
    let experiments = args.folders.iter().map(|folder| read(folder)).collect::<Result<Vec<_>>>()?;
    write_atomically(&args.out, results_document(&args.title, &experiments).as_bytes())?;
    outln!("{} experiments: {}", experiments.len(), args.out.display());
    Ok(ExitCode::SUCCESS)
}

fn read(folder: &Path) -> Result<ReportInput> {
    let path = folder.join("results.json");
    if !path.is_file() {
        bail!("{}: expected the folder of an experiment: it has no results.json", folder.display());
    }
    let records = read_records(&path)?;
    let plans = records
        .iter()
        .map(|record| RunPlan::of_run(&folder.join(run_directory(&record.scene, &record.variant, record.seed))));
    let plans = plans.collect::<Result<Vec<_>>>()?;
    let Some(experiment) = records.first().map(|record| record.experiment.clone()) else {
        bail!("{}: expected at least one record", path.display());
    };
    let mut about = About::of_results(&experiment);
    about.data.clone_from(&plans[0].data);
    let input = about.report_input(records, &plans.iter().collect::<Vec<_>>())?;
    Ok(ReportInput { command: command_line::read(folder), ..input })
}
