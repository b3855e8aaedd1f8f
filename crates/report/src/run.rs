use std::path::PathBuf;

use crate::Record;

/// Identity of a run: saving a record replaces the one with the same key.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RunKey {
    /// [`Record::experiment`].
    pub experiment: String,
    /// [`Record::scene`].
    pub scene: String,
    /// [`Record::variant`].
    pub variant: String,
    /// [`Record::seed`].
    pub seed: u64,
    /// [`Record::preset`].
    pub preset: String,
}

impl From<&Record> for RunKey {
    fn from(record: &Record) -> Self {
        Self {
            experiment: record.experiment.clone(),
            scene: record.scene.clone(),
            variant: record.variant.clone(),
            seed: record.seed,
            preset: record.preset.clone(),
        }
    }
}

/// Name of the page in a run's folder that shows the scene in 3D; reports open it in place.
pub const VIEWER_PAGE: &str = "viewer.html";

/// Run in a report: its record, and the folder with its images and events.
///
/// The folder holds `test/NNN.png` (renders), `truth/NNN.png`, `depth/NNN.png`, `error/NNN.png` and `metrics.jsonl`,
/// each of which may be missing. Images of the same name show the same view.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Measurements of the run.
    pub record: Record,
    /// Folder of the run, relative to the report.
    pub directory: PathBuf,
}

impl From<Record> for Run {
    fn from(record: Record) -> Self {
        Self { directory: run_directory(&record.scene, &record.variant, record.seed), record }
    }
}

impl AsRef<Record> for Run {
    fn as_ref(&self) -> &Record {
        &self.record
    }
}

impl Run {
    /// Returns `lego / infonerf / seed 0`.
    pub(crate) fn label(&self) -> String {
        format!("{} / {} / seed {}", self.record.scene, self.record.label(), self.record.seed)
    }
}

/// Returns the folder of a run below its experiment's: `<scene>/<variant>/seed<N>`.
pub fn run_directory(scene: &str, variant: &str, seed: u64) -> PathBuf {
    [scene, variant, &format!("seed{seed}")].iter().collect()
}
