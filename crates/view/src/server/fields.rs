//! Fields of runs as packages, kept until a newer checkpoint is there.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Result;
use infonerf_experiment::{OpenDevice, RunPlan, Trained, is_finished};
use infonerf_scene::Scene;

use super::runs::stamp;
use crate::{baked, package};

/// The most packages that are kept.
const KEPT: usize = 16;

/// Makes packages, one at a time.
pub(super) struct Fields {
    device: OpenDevice,
    made: Mutex<Vec<Made>>,
}

/// A package with what it was made from.
struct Made {
    run: PathBuf,
    config: String,
    stamp: u64,
    finished: bool,
    scene: Arc<Scene>,
    package: Arc<str>,
}

impl Fields {
    pub(super) fn new(device: OpenDevice) -> Self {
        Self { device, made: Mutex::default() }
    }

    /// The package of a run's first field, from its newest checkpoint. A baked one has fewer voxels until the run is
    /// finished.
    ///
    /// # Errors
    /// If the run has no checkpoint, or its scene cannot be read.
    pub(super) fn package(&self, run: &Path) -> Result<Arc<str>> {
        let mut made = self.made.lock().unwrap_or_else(PoisonError::into_inner);
        let (stamp, finished) = (stamp(run), is_finished(run));
        let config = fs::read_to_string(run.join("config.toml"))?;
        let before = made.iter().position(|made| made.run == run && made.config == config);
        let before = before.map(|index| made.remove(index));
        if let Some(same) = before.as_ref().filter(|made| (made.stamp, made.finished) == (stamp, finished)) {
            let package = same.package.clone();
            made.extend(before);
            return Ok(package);
        }
        let plan = RunPlan::of_run(run)?;
        let scene = match before {
            Some(before) => before.scene,
            None => Arc::new(plan.load()?),
        };
        let trained = Trained::on_scene(plan, scene.clone(), run, &self.device)?;
        let field = &trained.plan.config.field;
        let voxels = if finished { baked::resolution(field) } else { baked::live_resolution(field) };
        let package: Arc<str> = package::of_run(&trained, &trained.trainers[0].trained(), voxels)?.to_string().into();
        if made.len() == KEPT {
            made.remove(0);
        }
        made.push(Made { run: run.to_owned(), config, stamp, finished, scene, package: package.clone() });
        Ok(package)
    }
}
