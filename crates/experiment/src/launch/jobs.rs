//! `jobs.json`: which jobs a launch has submitted, so that no second one starts beside it.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use infonerf_report::write_atomically;
use serde::{Deserialize, Serialize};

use super::{Launcher, Live, Resources, launch_folder};

const NAME: &str = "jobs.json";

/// The jobs of a launch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Jobs {
    pub(super) launcher: Launcher,
    /// Ids, that of the job that merges among them.
    pub(super) ids: Vec<String>,
}

impl Jobs {
    /// Those of the launch of the manifest in `folder`, if there was one.
    fn read(folder: &Path) -> Result<Option<Self>> {
        let path = launch_folder(folder).join(NAME);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read(&path).with_context(|| path.display().to_string())?;
        serde_json::from_slice(&text).map(Some).with_context(|| path.display().to_string())
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        Ok(write_atomically(&launch_folder(folder).join(NAME), &serde_json::to_vec_pretty(self)?)?)
    }
}

/// Refuses to touch the manifest in `folder` while jobs of a launch run its items.
pub(crate) fn refuse_under_way(folder: &Path) -> Result<()> {
    let Some(jobs) = Jobs::read(folder)? else { return Ok(()) };
    let path = launch_folder(folder).join(NAME);
    let Some(scheduler) = jobs.launcher.scheduler(Resources::default())? else { return Ok(()) };
    let Live { waiting, running } = scheduler.live(&jobs.ids).with_context(|| {
        format!("{}: whether its jobs have ended cannot be told (remove the file if they have)", path.display())
    })?;
    if waiting + running > 0 {
        bail!(
            "{}: a launch is under way: {waiting} of its tasks wait and {running} run: wait for them, or `{}`",
            folder.display(),
            scheduler.cancel(&jobs.ids)
        );
    }
    Ok(())
}
