//! One item of a manifest, run by this process.

use std::path::Path;

use anyhow::{Context, Result, bail};
use infonerf_metrics::Networks;
use infonerf_report::save_own_record;

use super::manifest;
use crate::{Existing, Finished, OpenDevice, Session, Watch};

/// Runs item `index` of the manifest at `path`, up to the share `until` of it; a finished one is kept. Results go into the
/// manifest's folder: a file of its own, which no other process writes. The list of all is made when they are merged.
///
/// # Errors
/// As [`Session::run`], and if there is no such item.
pub fn run_item(
    path: &Path,
    index: usize,
    device: OpenDevice,
    networks: Networks,
    until: Option<f64>,
    watch: &mut Watch<'_>,
) -> Result<Finished> {
    let plan = manifest::read_item(path, index)?;
    let path = std::path::absolute(path).with_context(|| path.display().to_string())?;
    let folder = path.parent().filter(|folder| folder.file_name().is_some_and(|name| *name == *plan.experiment));
    let Some((folder, out)) = folder.and_then(|folder| Some((folder, folder.parent()?))) else {
        bail!("{}: expected to be in the folder {}", path.display(), plan.experiment);
    };
    let session = Session::new(device, out, Existing::Continue).until(until).with_networks(networks);
    let finished = session.run(&plan, watch)?;
    if let Finished::Record(record, _) = &finished {
        save_own_record(folder, record)?;
    }
    Ok(finished)
}
