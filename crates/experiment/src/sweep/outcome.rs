//! What a sweep writes from its records: `results.json`, tables and the report.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use infonerf_report::{
    Quantity, Record, ReportInput, RunKey, Setting, Table, overview_table, read_records, write_records, write_report,
};

use super::best;
use super::figures::figures;
use super::plan::{Item, Sweep};
use crate::RunPlan;

/// The files that a sweep has written.
pub struct Outcome {
    /// The variants that the report shows, in the order of the sweep: the files hold all.
    pub table: Table,
    /// What the report is made of.
    pub input: ReportInput,
    /// The page.
    pub report: PathBuf,
    /// The numbers.
    pub results: PathBuf,
}

/// Writes what is finished, in the order of the sweep, without the items of `left_out`; nothing where nothing is finished.
pub(super) fn write(
    sweep: &Sweep,
    folder: &Path,
    left_out: &HashSet<usize>,
    warnings: Vec<String>,
) -> Result<Option<Outcome>> {
    let records = records(sweep, folder, left_out)?;
    if records.is_empty() {
        return Ok(None);
    }
    let figures = figures(sweep, &records)?;
    let claims = best::claims(sweep, &records);
    let records = with_settings(sweep, records)?;
    write_results(folder, &records)?;
    let table = overview_table(&records, &Quantity::all());
    for (name, text) in
        [("table.md", table.to_markdown()), ("table.csv", table.to_csv()), ("table.tex", table.to_latex())]
    {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    let runs: Vec<&RunPlan> = sweep.runs().collect();
    let mut input = sweep.about.report_input(records, &runs)?;
    input.figures.extend(figures);
    input.claims.extend(claims);
    input.warnings.extend(warnings);
    let files = write_report(&input, folder)?;
    let table = overview_table(&input.shown_runs(), &Quantity::all());
    Ok(Some(Outcome { table, input, report: files.html, results: folder.join("results.json") }))
}

/// The records of the items that are finished.
fn records(sweep: &Sweep, folder: &Path, left_out: &HashSet<usize>) -> Result<Vec<Record>> {
    let mut records = Vec::new();
    for (_, item) in sweep.items.iter().enumerate().filter(|(index, _)| !left_out.contains(index)) {
        let path = item.plan.record_path(&folder.join(item.plan.directory()));
        if path.exists() {
            records.extend(read_records(&path)?);
        }
    }
    Ok(records)
}

/// The records, each with what the sweep set.
fn with_settings(sweep: &Sweep, mut records: Vec<Record>) -> Result<Vec<Record>> {
    let mut settings: HashMap<&str, Setting> = HashMap::new();
    for Item { plan, variant, setting } in &sweep.items {
        if let Entry::Vacant(new) = settings.entry(&plan.variant) {
            let assignments = sweep.space.assignments(setting)?;
            let values = assignments.iter().filter_map(|assignment| assignment.split_once('='));
            let values = values.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
            new.insert(Setting { variant: variant.clone(), values });
        }
    }
    let set = |setting: &&Setting| !setting.values.is_empty();
    for record in &mut records {
        record.setting = settings.get(record.variant.as_str()).filter(set).cloned();
    }
    Ok(records)
}

/// Writes `results.json` with `records` last and in their order, however many processes made them.
fn write_results(folder: &Path, records: &[Record]) -> Result<()> {
    let path = folder.join("results.json");
    let listed = if path.exists() { read_records(&path)? } else { Vec::new() };
    let own: HashSet<RunKey> = records.iter().map(RunKey::from).collect();
    let others = listed.into_iter().filter(|record| !own.contains(&record.into()));
    let all: Vec<Record> = others.chain(records.iter().cloned()).collect();
    Ok(write_records(&path, &all)?)
}
