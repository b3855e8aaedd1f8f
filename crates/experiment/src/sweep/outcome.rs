//! Writes `results.json`, tables and the report from a sweep's records, and reads the input of reports.

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use infonerf_report::{Quantity, Record, ReportInput, Setting, Table, overview_table, run_directory, write_report};

use super::figures::figures;
use super::{Item, Sweep, assignments};
use crate::identity::differences;
use crate::plan::About;
use crate::records::{LIST, found_below, list_records, read_records};
use crate::run_plan::RunPlan;

/// Files that a sweep has written, and what they contain.
pub struct SweepFiles {
    /// Table of the variants that the report shows, in the order of the sweep. The files have all variants.
    pub table: Table,
    /// Input of the report.
    pub input: ReportInput,
    /// Path of the report's page.
    pub report: PathBuf,
    /// Path of the list of records, `results.json`.
    pub results: PathBuf,
}

/// Reads the records of the experiment or sweep in `folder`.
///
/// # Errors
/// If there is no list of records, or it cannot be read.
pub fn results(folder: &Path) -> Result<Vec<Record>> {
    let path = folder.join(LIST);
    let hint = || found_below(folder, LIST);
    let expected = "expected the folder of an experiment that has a finished run, with a";
    ensure!(path.is_file(), "{}: {expected} {LIST}{}", folder.display(), hint());
    read_records(&path)
}

/// Reads the input of a report on the experiment or sweep in `folder`. Runs of a variant with different settings have a row each.
///
/// # Errors
/// If there are no records, or the folder of one of the runs is gone.
pub fn collect(folder: &Path) -> Result<ReportInput> {
    let records = results(folder)?;
    let first = records.first().with_context(|| format!("{}: expected at least one record", folder.display()))?;
    let mut about = About::of_results(&first.experiment);
    let run = |record: &Record| folder.join(run_directory(&record.scene, &record.variant, record.seed));
    let plans = records.iter().map(|record| RunPlan::of_run(&run(record))).collect::<Result<Vec<_>>>()?;
    about.data.clone_from(&plans[0].data);
    // A run that was begun anew with another preset has left its earlier record in the list.
    let pairs = records.into_iter().zip(plans).filter(|(record, plan)| record.preset == plan.preset.name());
    let (mut records, plans): (Vec<_>, Vec<_>) = pairs.unzip();
    separate(&mut records, &plans)?;
    about.report_input(records, &plans.iter().collect::<Vec<_>>())
}

/// Adds to the variant of each run the settings in which it differs from the first run of the same variant and preset.
fn separate(records: &mut [Record], plans: &[RunPlan]) -> Result<()> {
    let mut firsts: HashMap<(&str, &str), toml::Table> = HashMap::new();
    for (record, plan) in records.iter_mut().zip(plans) {
        let mut config: toml::Table = toml::to_string(&plan.config)?.parse()?;
        config.extend(plan.budget.map(|budget| ("budget_seconds".to_owned(), budget.into())));
        let first = firsts.entry((&plan.variant, plan.preset.name())).or_insert_with(|| config.clone());
        let differences = differences(first, &config);
        if !differences.is_empty() {
            let variant = record.variant.clone();
            let setting = record.setting.get_or_insert_with(|| Setting { variant, ..Setting::default() });
            setting.values.extend(differences.into_iter().map(|difference| (difference.key, difference.now)));
            record.variant = record.label();
        }
    }
    Ok(())
}

impl Sweep {
    /// Writes the results of finished runs but `left_out` into `folder`, in the order of the sweep; `None` if no run is finished.
    pub(crate) fn write_outcome(&self, folder: &Path, left_out: &BTreeSet<usize>) -> Result<Option<SweepFiles>> {
        let (mut items, mut records) = (Vec::new(), Vec::new());
        for (_, item) in self.items.iter().enumerate().filter(|(index, _)| !left_out.contains(index)) {
            let path = item.plan.record_path(&folder.join(item.plan.directory()));
            if path.exists() {
                records.extend(read_records(&path)?.pop());
                items.push(item);
            }
        }
        if records.is_empty() {
            return Ok(None);
        }
        let figures = figures(self, &records)?;
        records.iter_mut().zip(items).for_each(|(record, item)| record.setting = self.setting_of(item));
        list_records(folder, &records)?;
        let table = overview_table(&records, &Quantity::all());
        let formats = [("md", table.to_markdown()), ("tex", table.to_latex()), ("csv", table.to_csv())];
        for (extension, text) in formats {
            let path = folder.join("table").with_extension(extension);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        let runs: Vec<&RunPlan> = self.runs().collect();
        let mut input = self.about.report_input(records, &runs)?;
        input.figures.extend(figures);
        let report = write_report(&input, folder)?;
        let table = overview_table(&input.shown_records(), &Quantity::all());
        Ok(Some(SweepFiles { table, input, report, results: folder.join(LIST) }))
    }

    /// Returns the variant of a run and the values that the sweep has set in it; `None` if there are no grids.
    fn setting_of(&self, item: &Item) -> Option<Setting> {
        let assignments = assignments(&self.grids, &item.choice);
        let values = assignments.iter().filter_map(|assignment| assignment.split_once('='));
        let values = values.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
        (!assignments.is_empty()).then(|| Setting { variant: item.variant.clone(), values })
    }
}
