//! The results of an experiment as its folder holds them.

use std::path::Path;

use anyhow::{Context, Result, bail};
use infonerf_report::{ReportInput, run_directory};

use crate::records::{LIST, read_records};
use crate::{About, RunPlan};

/// Reads what a report of the experiment or sweep in `folder` is made of.
///
/// # Errors
/// If there are no records, or the folder of one of the runs is gone.
pub fn collect(folder: &Path) -> Result<ReportInput> {
    let path = folder.join(LIST);
    if !path.is_file() {
        bail!("{}: expected the folder of an experiment: it has no {LIST}", folder.display());
    }
    let records = read_records(&path)?;
    let run = |scene: &str, variant: &str, seed| RunPlan::of_run(&folder.join(run_directory(scene, variant, seed)));
    let plans = records.iter().map(|record| run(&record.scene, &record.variant, record.seed));
    let plans = plans.collect::<Result<Vec<_>>>()?;
    let first = records.first().with_context(|| format!("{}: expected at least one record", path.display()))?;
    let mut about = About::of_results(&first.experiment);
    about.data.clone_from(&plans[0].data);
    about.report_input(records, &plans.iter().collect::<Vec<_>>())
}
