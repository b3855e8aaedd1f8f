//! The manifest: one line an item, each with all that its run needs.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;

use anyhow::{Context, Result, bail};
use infonerf_dataset::SceneSource;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::plan::Item;
use crate::RunPlan;

/// File name, in the folder of the sweep.
pub(super) const NAME: &str = "manifest.jsonl";
/// Of the manifest's format.
const VERSION: u64 = 1;
/// Of the program: another one may give other numbers.
const PROGRAM: &str = env!("CARGO_PKG_VERSION");

#[derive(Serialize, Deserialize)]
struct Line {
    version: u64,
    program: String,
    item: usize,
    scene: String,
    /// Where the scene is.
    source: String,
    variant: String,
    seed: u64,
    /// The complete `config.toml` of the run.
    config: String,
}

/// Writes the manifest, whole or not at all.
pub(super) fn write(path: &Path, items: &[Item]) -> Result<()> {
    let line = |(item, Item { plan, .. }): (usize, &Item)| -> Result<String> {
        let source = match &plan.source {
            SceneSource::Procedural(name) => format!("built-in scene {name}"),
            SceneSource::Folder { path } => {
                std::path::absolute(path).unwrap_or_else(|_| path.clone()).display().to_string()
            }
        };
        let line = Line {
            version: VERSION,
            program: PROGRAM.to_owned(),
            item,
            scene: plan.scene.clone(),
            source,
            variant: plan.variant.clone(),
            seed: plan.seed,
            config: plan.to_toml()?,
        };
        Ok(serde_json::to_string(&line)? + "\n")
    };
    let lines: Result<Vec<String>> = items.par_iter().enumerate().map(line).collect();
    let text = lines?.concat();
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    Ok(infonerf_report::write_atomically(path, text.as_bytes())?)
}

/// Reads item `index`, and refuses a manifest of another version.
pub(crate) fn read_item(path: &Path, index: usize) -> Result<RunPlan> {
    let line = read_line(path, index)?.with_context(|| {
        format!("{}: item {index}: expected one of the manifest's items, counted from 0", path.display())
    })?;
    let context = || format!("{}: line {}", path.display(), index + 1);
    let plan = RunPlan::from_toml(&line.config).with_context(context)?;
    if (line.item, &line.scene, &line.variant, line.seed) != (index, &plan.scene, &plan.variant, plan.seed) {
        bail!("{}: expected item {index}, and its config to be of the same scene, variant and seed", context());
    }
    Ok(plan)
}

/// Refuses a manifest of another version of the format or of the program, if there is one.
pub(super) fn refuse_another_version(path: &Path) -> Result<()> {
    if path.exists() {
        read_line(path, 0).context("a sweep is there already")?;
    }
    Ok(())
}

fn read_line(path: &Path, index: usize) -> Result<Option<Line>> {
    let name = || path.display().to_string();
    let file = fs::File::open(path).with_context(name)?;
    let Some(text) = BufReader::new(file).lines().nth(index) else { return Ok(None) };
    let context = || format!("{}: line {}", path.display(), index + 1);
    let value: Value = serde_json::from_str(&text.with_context(name)?).with_context(context)?;
    // First, since the fields of another version may differ.
    let (version, program) = (&value["version"], &value["program"]);
    if *version != VERSION || *program != PROGRAM {
        bail!(
            "{}: expected a manifest of version {VERSION} of infonerf {PROGRAM}, found version {version} of {program}: \
             sweep again, into another folder",
            path.display()
        );
    }
    serde_json::from_value(value).map(Some).with_context(context)
}
