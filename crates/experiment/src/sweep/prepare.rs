use std::fs;
use std::path::{Path, PathBuf};
use std::slice;

use anyhow::{Context, Result};

use super::{Sweep, manifest};
use crate::device::DeviceName;
use crate::execute::check_no_running_jobs;
use crate::identity::Identity;
use crate::records::{LIST, read_records};
use crate::run::{Existing, clear, lock};

/// Folder of a sweep, and its missing runs.
pub struct Prepared {
    /// Indices of the runs that are not finished, in increasing order.
    pub missing: Vec<usize>,
    /// A warning for the user.
    pub warning: Option<String>,
    pub(crate) folder: PathBuf,
    /// Lock that keeps other processes from preparing the same sweep.
    _lock: Option<fs::File>,
}

impl Sweep {
    /// Finds the runs below `out` that are not finished on `device`, and refuses runs of another config. Writes nothing.
    pub(crate) fn find_missing(&self, out: &Path, device: DeviceName) -> Result<Prepared> {
        let mut prepared = Prepared { missing: Vec::new(), ..self.all_missing(out)? };
        for (index, plan) in self.runs().enumerate() {
            let run = prepared.folder.join(plan.directory());
            let is_begun = run.join("config.toml").exists();
            let identity = || Identity::of(slice::from_ref(plan), device.name());
            let is_same = is_begun && !identity()?.check_continuation(&run, &plan.to_toml()?)?;
            if !is_same || !plan.record_path(&run).exists() {
                prepared.missing.push(index);
            }
        }
        Ok(prepared)
    }

    /// Takes all runs as missing. Refuses a list of records below `out` that cannot be read, to which none could be added.
    pub(crate) fn all_missing(&self, out: &Path) -> Result<Prepared> {
        let (folder, missing) = (self.folder(out), (0..self.runs().len()).collect());
        let list = folder.join(LIST);
        if list.exists() {
            read_records(&list).context("records are added to this file: move it away")?;
        }
        Ok(Prepared { missing, warning: None, folder, _lock: None })
    }

    /// Writes the manifest below `out`, for processes that run an item each, and finds the runs that are missing on `device`. No
    /// other process can prepare the same sweep until the returned value is dropped.
    pub(crate) fn prepare(&self, out: &Path, device: DeviceName) -> Result<Prepared> {
        let folder = self.folder(out);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let (own_lock, warning) = lock(&folder, "sweep")?;
        manifest::refuse_another_version(&folder.join(manifest::NAME))?;
        check_no_running_jobs(&folder)?;
        if self.existing == Existing::Overwrite {
            // Files are removed once every run is locked against other processes.
            let runs = self.runs().map(|plan| folder.join(plan.directory())).filter(|run| run.exists());
            let locked = runs.map(|run| Ok((lock(&run, "run")?, run))).collect::<Result<Vec<_>>>()?;
            locked.iter().try_for_each(|(_lock, run)| clear(run))?;
        }
        let prepared = Prepared { warning, _lock: Some(own_lock), ..self.find_missing(out, device)? };
        manifest::write(&folder.join(manifest::NAME), self.runs())?;
        Ok(prepared)
    }
}
