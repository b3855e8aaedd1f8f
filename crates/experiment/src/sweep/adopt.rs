//! Reusing runs that another sweep has finished under another name.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use infonerf_report::{Record, read_records, write_atomically, write_records};

use super::{Prepared, Sweep};
use crate::run::{clear, lock};
use crate::{DeviceName, Identity, RunPlan};

impl Sweep {
    /// Takes over from `others`, whose results are below `out` as well, each missing run that differs from a finished one of
    /// theirs in its names alone: its folder is copied, and its record says what it is called here. Returns how many
    /// there were. Runs with a time budget are not: the clock decides their numbers.
    ///
    /// # Errors
    /// If a file cannot be read or written, or another process is at work on a run.
    pub fn adopt(&self, prepared: &mut Prepared, others: &[&Self], out: &Path, device: DeviceName) -> Result<usize> {
        let mut known: HashMap<String, (&Self, &RunPlan)> = HashMap::new();
        for other in others {
            for item in &other.items {
                if let Some(numbers) = numbers(&item.plan)? {
                    known.entry(numbers).or_insert((other, &item.plan));
                }
            }
        }
        let state = &mut prepared.state;
        let (before, mut missing) = (state.missing.len(), Vec::new());
        for index in std::mem::take(&mut state.missing) {
            let plan = &self.items[index].plan;
            let twin = numbers(plan)?.and_then(|numbers| known.get(&numbers));
            let taken = match twin {
                Some((other, twin)) => {
                    let from = out.join(&other.about.name).join(twin.directory());
                    take_over(plan, &state.folder.join(plan.directory()), twin, &from, device)?
                }
                None => false,
            };
            if !taken {
                missing.push(index);
            }
        }
        let taken = before - missing.len();
        (state.missing, state.kept) = (missing, state.kept + taken);
        Ok(taken)
    }
}

/// All that a run's numbers depend on, its names left out; none if the clock has a part in them.
fn numbers(plan: &RunPlan) -> Result<Option<String>> {
    if plan.budget.is_some() {
        return Ok(None);
    }
    let config = serde_json::to_string(&plan.config)?;
    Ok(Some(format!("{:?} {} {} {config}", plan.source, plan.seed, plan.preset.name())))
}

/// Makes `folder` of `plan` out of `from` of `twin`, if that is finished and nothing has changed since.
fn take_over(plan: &RunPlan, folder: &Path, twin: &RunPlan, from: &Path, device: DeviceName) -> Result<bool> {
    let record = twin.record_path(from);
    if !record.exists() || Identity::read(from) != Some(Identity::of(twin, device.name())?) {
        return Ok(false);
    }
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let (_lock, _) = lock(folder, "run")?;
    clear(folder)?;
    copy(from, folder)?;
    write_atomically(&folder.join("config.toml"), plan.to_toml()?.as_bytes())?;
    Identity::of(plan, device.name())?.write(folder)?;
    let named =
        |record: Record| Record { experiment: plan.experiment.clone(), variant: plan.variant.clone(), ..record };
    let records: Vec<Record> = read_records(&record)?.into_iter().map(named).collect();
    // Last: it says that the run is finished.
    Ok(write_records(&plan.record_path(folder), &records).map(|()| true)?)
}

/// Copies what a run left, but for its record and lock.
fn copy(from: &Path, to: &Path) -> Result<()> {
    for entry in fs::read_dir(from).with_context(|| from.display().to_string())? {
        let path = entry.with_context(|| from.display().to_string())?.path();
        let name = path.file_name().unwrap_or_default();
        let (text, place) = (name.to_string_lossy(), to.join(name));
        if path.is_dir() {
            fs::create_dir_all(&place).with_context(|| place.display().to_string())?;
            copy(&path, &place)?;
        } else if text != "lock" && !text.starts_with("record-") {
            fs::copy(&path, &place).with_context(|| place.display().to_string())?;
        }
    }
    Ok(())
}
