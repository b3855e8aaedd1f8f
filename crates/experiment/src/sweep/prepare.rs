//! Finds the runs of a sweep that are to do, and takes over those that another sweep has finished under another name.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use infonerf_report::{Record, write_atomically};

use super::{Sweep, manifest};
use crate::execute::refuse_under_way;
use crate::records::{LIST, read_records, write_records};
use crate::run::{clear, lock};
use crate::{DeviceName, Existing, Identity, RunPlan};

/// A sweep's folder, and which of its runs are to do.
pub struct Prepared {
    /// Runs that are not finished, rising.
    pub missing: Vec<usize>,
    /// Number of runs that were finished before.
    pub kept: usize,
    /// Number of the finished runs that were taken over from another sweep.
    pub adopted: usize,
    /// A warning for the user.
    pub warning: Option<String>,
    pub(crate) folder: PathBuf,
    /// Keeps other processes from preparing the same sweep.
    _lock: Option<fs::File>,
}

impl Prepared {
    /// Returns the manifest: one line per run.
    pub(crate) fn manifest(&self) -> PathBuf {
        self.folder.join(manifest::NAME)
    }
}

impl Sweep {
    /// Finds what is finished on `device` below `out`, whatever made it. Writes nothing.
    ///
    /// # Errors
    /// If a run of another config is in the way, or a file cannot be read.
    pub(crate) fn look(&self, out: &Path, device: DeviceName) -> Result<Prepared> {
        let mut prepared = Prepared { missing: Vec::new(), ..self.all_missing(out)? };
        for (index, plan) in self.runs().enumerate() {
            let run = prepared.folder.join(plan.directory());
            let is_begun = run.join("config.toml").exists();
            let is_same = is_begun && !Identity::of(plan, device.name())?.continues(&run, &plan.to_toml()?)?;
            if is_same && plan.record_path(&run).exists() {
                prepared.kept += 1;
            } else {
                prepared.missing.push(index);
            }
        }
        Ok(prepared)
    }

    /// Takes all runs as to be done, whatever is there below `out`.
    ///
    /// # Errors
    /// If there is a list of records that cannot be read, to which records could not be added.
    pub(crate) fn all_missing(&self, out: &Path) -> Result<Prepared> {
        let (folder, missing) = (self.folder(out), (0..self.len()).collect());
        let list = folder.join(LIST);
        if list.exists() {
            read_records(&list).context("records are added to this file: move it away")?;
        }
        Ok(Prepared { missing, kept: 0, adopted: 0, warning: None, folder, _lock: None })
    }

    /// Writes the manifest below `out`, for processes that run an item each, and finds what is to do on `device`. No other
    /// process prepares the same sweep for as long as what is returned lives.
    ///
    /// # Errors
    /// As [`Self::look`], and if another process or a launch is at work on it, or a manifest of another version is there.
    pub(crate) fn prepare(&self, out: &Path, device: DeviceName) -> Result<Prepared> {
        let folder = self.folder(out);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let (lock, warning) = lock(&folder, "sweep")?;
        manifest::refuse_another_version(&folder.join(manifest::NAME))?;
        refuse_under_way(&folder)?;
        if self.existing == Existing::Overwrite {
            self.remove_runs(&folder)?;
        }
        let prepared = Prepared { warning, _lock: Some(lock), ..self.look(out, device)? };
        manifest::write(&prepared.manifest(), self.runs())?;
        Ok(prepared)
    }

    /// Removes what its runs left in `folder`, once no other process is at work on any of them.
    fn remove_runs(&self, folder: &Path) -> Result<()> {
        let runs = self.runs().map(|plan| folder.join(plan.directory())).filter(|run| run.exists());
        let locked = runs.map(|run| Ok((lock(&run, "run")?, run))).collect::<Result<Vec<_>>>()?;
        locked.iter().try_for_each(|(_lock, run)| clear(run))
    }

    /// Takes over from `others`, whose results are below `out` as well, each missing run that differs from a finished one of
    /// theirs in its names alone: its folder is copied, and its record has the names of this one. Runs with a time budget
    /// are not taken over: the clock decides their numbers.
    ///
    /// # Errors
    /// If a file cannot be read or written, or another process is at work on a run.
    pub(crate) fn adopt(&self, prepared: &mut Prepared, others: &[Self], out: &Path, device: DeviceName) -> Result<()> {
        let mut known: HashMap<String, (PathBuf, &RunPlan)> = HashMap::new();
        for other in others {
            for plan in other.runs() {
                known.entry(numbers(plan)?).or_insert_with(|| (other.folder(out).join(plan.directory()), plan));
            }
        }
        for index in std::mem::take(&mut prepared.missing) {
            let plan = self.run(index);
            let twin = known.get(&numbers(plan)?).filter(|_| plan.budget.is_none());
            let folder = prepared.folder.join(plan.directory());
            match twin {
                Some((from, twin)) if take_over(plan, &folder, twin, from, device)? => prepared.adopted += 1,
                _ => prepared.missing.push(index),
            }
        }
        prepared.kept += prepared.adopted;
        Ok(())
    }
}

/// Returns all that a run's numbers depend on, its names and the clock left out.
fn numbers(plan: &RunPlan) -> Result<String> {
    let config = serde_json::to_string(&plan.config)?;
    Ok(format!("{:?} {} {} {:?} {config}", plan.source, plan.seed, plan.preset.name(), plan.budget))
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
    Identity::of(plan, device.name())?.write(folder)?;
    write_atomically(&folder.join("config.toml"), plan.to_toml()?.as_bytes())?;
    let named =
        |record: Record| Record { experiment: plan.experiment.clone(), variant: plan.variant.clone(), ..record };
    let records: Vec<Record> = read_records(&record)?.into_iter().map(named).collect();
    // Last: it says that the run is finished.
    write_records(&plan.record_path(folder), &records)?;
    Ok(true)
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
