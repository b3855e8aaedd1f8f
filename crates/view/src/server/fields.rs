//! Packages of runs, which are kept until there is a newer checkpoint.

use std::collections::hash_map::DefaultHasher;
use std::fs;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::Result;
use infonerf_experiment::{OpenDevice, RunPlan, Trained, is_finished};
use infonerf_report::write_atomically;
use infonerf_scene::Scene;

use super::runs::{first_field, stamp};
use crate::factored::is_exact;
use crate::page::VIEWER;
use crate::shader::TEMPLATE;
use crate::{baked, package};

/// Maximum number of runs whose packages are kept in memory.
const MAX_RUNS: usize = 16;
/// Name of the file next to the checkpoint of a finished run, which has a line with its version, and its package.
const FILE: &str = "viewer.json";

/// Packages of runs; packages of different runs can be made at the same time.
pub(super) struct Fields {
    device: OpenDevice,
    runs: Mutex<Vec<Arc<RunPackage>>>,
}

struct RunPackage {
    run: PathBuf,
    /// Locked while the package is made.
    made: Mutex<Option<Made>>,
    work: Mutex<&'static str>,
}

struct Made {
    version: Version,
    scene: Arc<Scene>,
    package: Arc<str>,
}

/// State of a run that a package depends on.
#[derive(PartialEq)]
struct Version {
    config: String,
    stamp: u64,
    finished: bool,
}

impl Fields {
    pub(super) fn new(device: OpenDevice) -> Self {
        Self { device, runs: Mutex::default() }
    }

    /// Returns the package of a run's first field at its newest checkpoint; a baked package is coarse until the run ends.
    pub(super) fn package(&self, run: &Path) -> Result<Arc<str>> {
        let entry = self.entry(run);
        let mut made = locked(&entry.made);
        let version = Version::of(run)?;
        if let Some(made) = made.as_ref().filter(|made| made.version == version) {
            return Ok(made.package.clone());
        }
        let file = first_field(run).join(FILE);
        let kept = fs::read_to_string(&file).unwrap_or_default();
        if let Some((_, package)) = kept.split_once('\n').filter(|(line, _)| *line == version.line()) {
            return Ok(package.into());
        }
        let doing = |work| *locked(&entry.work) = work;
        let result = self.make(run, version, made.take(), &doing);
        doing("");
        let new = made.insert(result?);
        if new.version.finished {
            // If the folder cannot be written to, the next server makes the package again.
            let _ = write_atomically(&file, format!("{}\n{}", new.version.line(), new.package).as_bytes());
        }
        Ok(new.package.clone())
    }

    /// Returns the work that is being done for the package of a run; empty if none is.
    pub(super) fn work(&self, run: &Path) -> &'static str {
        *locked(&self.entry(run).work)
    }

    fn entry(&self, run: &Path) -> Arc<RunPackage> {
        let mut runs = locked(&self.runs);
        let new = || RunPackage { run: run.to_owned(), made: Mutex::default(), work: Mutex::new("") };
        let known = runs.iter().position(|entry| entry.run == run).map(|index| runs.remove(index));
        let entry = known.unwrap_or_else(|| Arc::new(new()));
        if runs.len() == MAX_RUNS {
            runs.remove(0);
        }
        runs.push(entry.clone());
        entry
    }

    fn make(&self, run: &Path, version: Version, last: Option<Made>, doing: &dyn Fn(&'static str)) -> Result<Made> {
        let plan = RunPlan::of_run(run)?;
        doing("Reading the scene");
        let same = last.filter(|last| last.version.config == version.config).map(|last| last.scene);
        let scene = same.map_or_else(|| plan.load().map(Arc::new), Ok)?;
        doing("Reading the field");
        let trained = Trained::on_scene(plan, scene.clone(), run, &self.device)?;
        let field = &trained.plan.config.field;
        doing(if is_exact(field) { "Packing the field" } else { "Baking the field to voxels" });
        let voxels = if version.finished { baked::resolution(field) } else { baked::live_resolution(field) };
        let package = package::of_run(&trained, run, &trained.fields().swap_remove(0), voxels)?;
        Ok(Made { version, scene, package: package.to_string().into() })
    }
}

impl Version {
    fn of(run: &Path) -> Result<Self> {
        let config = fs::read_to_string(run.join("config.toml"))?;
        Ok(Self { config, stamp: stamp(run), finished: is_finished(run) })
    }

    /// Identifies the version, and the program that draws it, in one line.
    fn line(&self) -> String {
        let mut hasher = DefaultHasher::new();
        (env!("CARGO_PKG_VERSION"), [VIEWER, TEMPLATE], &self.config).hash(&mut hasher);
        format!("{:016x} {} {}", hasher.finish(), self.stamp, self.finished)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
