//! Results of several experiments as one document.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use infonerf_experiment::{About, RunPlan};
use infonerf_report::{Results, read_records, results_document, run_directory, write_atomically};

use crate::args::CollectArgs;

/// The file in an experiment's folder that holds its command line.
const COMMAND: &str = "command.txt";

pub(crate) fn run(args: &CollectArgs) -> Result<ExitCode> {
    let experiments = args.folders.iter().map(|folder| read(folder)).collect::<Result<Vec<_>>>()?;
    write_atomically(&args.out, results_document(&args.title, &experiments).as_bytes())?;
    println!("{} experiments: {}", experiments.len(), args.out.display());
    Ok(ExitCode::SUCCESS)
}

fn read(folder: &Path) -> Result<Results> {
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
    let mut about = About::read(&experiment)?;
    about.data.clone_from(&plans[0].data);
    let input = about.report_input(records, &plans.iter().collect::<Vec<_>>())?;
    Ok(Results { input, command: std::fs::read_to_string(folder.join(COMMAND)).ok() })
}

/// Leaves the command line of this process in an experiment's folder, without where results go.
pub(super) fn save_command(folder: &Path) -> Result<()> {
    let mut words = vec!["infonerf".to_owned()];
    let mut args = std::env::args().skip(1);
    while let Some(word) = args.next() {
        match word.as_str() {
            "--out" => drop(args.next()),
            word if word.starts_with("--out=") => {}
            word => words.push(word.to_owned()),
        }
    }
    let line = shlex::try_join(words.iter().map(String::as_str)).context("the command line")?;
    Ok(write_atomically(&folder.join(COMMAND), line.as_bytes())?)
}
