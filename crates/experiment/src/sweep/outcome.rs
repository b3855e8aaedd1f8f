//! Writes `results.json`, tables and the report from a sweep's records.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use infonerf_report::{Quantity, ReportInput, Setting, Table, overview_table, write_report};

use super::figures::figures;
use super::{Item, Sweep, assignments, best};
use crate::RunPlan;
use crate::records::{LIST, list_records, read_records};

/// The files that a sweep has written.
pub struct SweepFiles {
    /// The variants that the report shows, in the order of the sweep: the files hold all.
    pub table: Table,
    /// Input of the report.
    pub input: ReportInput,
    /// The page.
    pub report: PathBuf,
    /// The records.
    pub results: PathBuf,
}

impl Sweep {
    /// Writes what is finished into `folder`, in the order of the sweep, without the items of `left_out`; `None` if nothing
    /// is finished.
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
        let (figures, claims) = (figures(self, &records)?, best::claims(self, &records));
        records.iter_mut().zip(items).for_each(|(record, item)| record.setting = self.setting_of(item));
        list_records(folder, &records)?;
        let table = overview_table(&records, &Quantity::all());
        for (name, text) in [("table.md", table.to_markdown()), ("table.csv", table.to_csv())] {
            let path = folder.join(name);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        let runs: Vec<&RunPlan> = self.runs().collect();
        let mut input = self.about.report_input(records, &runs)?;
        input.figures.extend(figures);
        input.claims.extend(claims);
        let files = write_report(&input, folder)?;
        let table = overview_table(&input.shown_records(), &Quantity::all());
        Ok(Some(SweepFiles { table, input, report: files.html, results: folder.join(LIST) }))
    }

    /// Returns the names and values that the sweep set in a run; `None` if it sets nothing.
    fn setting_of(&self, item: &Item) -> Option<Setting> {
        let assignments = assignments(&self.grids, &item.choice);
        let values = assignments.iter().filter_map(|assignment| assignment.split_once('='));
        let values = values.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
        (!assignments.is_empty()).then(|| Setting { variant: item.variant.clone(), values })
    }
}
