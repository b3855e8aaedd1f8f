//! What is made of the records: `results.json`, tables and the report.

use std::fs;
use std::io::IsTerminal;
use std::path::Path;

use anyhow::{Context, Result};
use infonerf_report::{
    Emphasis, Metric, Record, ReportInput, RunKey, overview_table, read_records, run_directory, write_records,
    write_report,
};

use super::figures::figures;
use super::plan::Sweep;
use crate::experiment::RunPlan;
use crate::run::record_path;

/// Writes and prints what is finished, in the order of the sweep, and gives back what the report is made of; nothing
/// where nothing is finished.
pub(super) fn write(sweep: &Sweep, folder: &Path, warnings: Vec<String>) -> Result<Option<ReportInput>> {
    let records = records(sweep, folder)?;
    if records.is_empty() {
        return Ok(None);
    }
    list(folder, &records)?;
    let table = overview_table(&records, &Metric::ALL);
    for (name, text) in
        [("table.md", table.to_markdown()), ("table.csv", table.to_csv()), ("table.tex", table.to_latex())]
    {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    let emphasis = if std::io::stdout().is_terminal() { Emphasis::Terminal } else { Emphasis::Star };
    println!("\n{}", table.to_text(emphasis));
    let figures = figures(sweep, &records)?;
    let runs: Vec<&RunPlan> = sweep.items.iter().map(|item| &item.plan).collect();
    let mut input = sweep.about.report_input(records, &runs)?;
    input.figures.extend(figures);
    input.warnings.extend(warnings);
    let files = write_report(&input, folder)?;
    println!("report: {}\nnumbers: {}", files.html.display(), folder.join("results.json").display());
    Ok(Some(input))
}

/// The records of the items that are finished.
fn records(sweep: &Sweep, folder: &Path) -> Result<Vec<Record>> {
    let mut records = Vec::new();
    for item in &sweep.items {
        let plan = &item.plan;
        let run = folder.join(run_directory(&plan.scene, &plan.variant, plan.seed));
        let path = record_path(&run, plan);
        if path.exists() {
            records.extend(read_records(&path)?);
        }
    }
    Ok(records)
}

/// Writes `results.json` with `records` last and in their order, however many processes made them.
fn list(folder: &Path, records: &[Record]) -> Result<()> {
    let path = folder.join("results.json");
    let listed = if path.exists() { read_records(&path)? } else { Vec::new() };
    let own: Vec<RunKey> = records.iter().map(RunKey::from).collect();
    let others = listed.into_iter().filter(|record| !own.contains(&record.into()));
    let all: Vec<Record> = others.chain(records.iter().cloned()).collect();
    Ok(write_records(&path, &all)?)
}
