//! The manifest of a sweep: one line per item, with all that its run needs.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use infonerf_metrics::Networks;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::device::OpenDevice;
use crate::records::save_own_record;
use crate::run::{Existing, Finished, Session, Watch};
use crate::run_plan::RunPlan;

/// File name of the manifest in the folder of a sweep.
pub(crate) const NAME: &str = "manifest.jsonl";
/// Version of the program: another one may give other numbers.
const PROGRAM: &str = env!("CARGO_PKG_VERSION");

#[derive(Serialize, Deserialize)]
struct Line {
    program: String,
    run: String,
    /// The complete `config.toml` of the run.
    config: String,
}

/// Runs item `index` of the manifest at `path` in this process, or keeps its finished run. The record goes into a file in the
/// run's folder, which no other process writes. Merging makes the list of all records.
///
/// # Errors
/// As [`Session::run`], and if there is no such item.
pub fn run_item(
    path: &Path,
    index: usize,
    device: OpenDevice,
    networks: Networks,
    watch: &mut Watch<'_>,
) -> Result<Finished> {
    let missing = || format!("{}: item {index}: expected one of the manifest's items, counted from 0", path.display());
    let line = read_line(path, index)?.with_context(missing)?;
    let plan = RunPlan::from_toml(&line.config).with_context(|| format!("{}: line {}", path.display(), index + 1))?;
    let path = std::path::absolute(path).with_context(|| path.display().to_string())?;
    let folder = path.parent().filter(|folder| folder.file_name().is_some_and(|name| *name == *plan.experiment));
    let Some((folder, out)) = folder.and_then(|folder| Some((folder, folder.parent()?))) else {
        bail!("{}: expected to be in the folder {}", path.display(), plan.experiment);
    };
    let session = Session::new(device, out, Existing::Continue).with_networks(networks);
    let finished = session.run(&plan, watch)?;
    if let Finished::Record(record, _) = &finished {
        save_own_record(folder, record)?;
    }
    Ok(finished)
}

/// Writes the manifest, whole or not at all.
pub(super) fn write<'a>(path: &Path, runs: impl Iterator<Item = &'a RunPlan>) -> Result<()> {
    let line = |plan: &&RunPlan| -> Result<String> {
        let line = Line { program: PROGRAM.to_owned(), run: plan.label(), config: plan.to_toml()? };
        Ok(serde_json::to_string(&line)? + "\n")
    };
    let runs: Vec<&RunPlan> = runs.collect();
    let lines = runs.par_iter().map(line).collect::<Result<Vec<String>>>()?;
    Ok(infonerf_report::write_atomically(path, lines.concat().as_bytes())?)
}

pub(super) fn refuse_another_version(path: &Path) -> Result<()> {
    if path.exists() {
        read_line(path, 0).context("a sweep is there already")?;
    }
    Ok(())
}

fn read_line(path: &Path, index: usize) -> Result<Option<Line>> {
    let name = path.display();
    let file = fs::File::open(path).with_context(|| name.to_string())?;
    let Some(text) = BufReader::new(file).lines().nth(index) else { return Ok(None) };
    let text = text.with_context(|| name.to_string())?;
    let line: Line = serde_json::from_str(&text).with_context(|| format!("{name}: line {}", index + 1))?;
    ensure!(
        line.program == PROGRAM,
        "{name}: expected a manifest of version {PROGRAM} of infonerf, found one of {}: sweep again, into another folder",
        line.program
    );
    Ok(Some(line))
}
