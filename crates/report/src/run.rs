use std::path::PathBuf;

use crate::Record;

/// What makes a run the same run: saving a record replaces the one with the same key.
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

/// The page in a run's folder that shows its scene in 3D, if the run left one: reports open it in place.
pub const VIEWER_PAGE: &str = "viewer.html";

/// A run in a report: its record, and where its pictures and events lie.
///
/// The folder holds `test/NNN.png` (renders), `truth/NNN.png`, `depth/NNN.png`, `error/NNN.png` and `metrics.jsonl`,
/// each of which may be missing. Pictures of the same name show the same view.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// What the run measured.
    pub record: Record,
    /// Folder of the run, relative to the report.
    pub directory: PathBuf,
}

impl From<Record> for Run {
    /// A run in its usual folder, [`run_directory`].
    fn from(record: Record) -> Self {
        Self { directory: run_directory(&record.scene, &record.variant, record.seed), record }
    }
}

impl Run {
    /// `lego / infonerf / seed 0`.
    pub(crate) fn label(&self) -> String {
        format!("{} / {} / seed {}", self.record.scene, self.record.label(), self.record.seed)
    }
}

/// Folder of a run below its experiment's: `<scene>/<variant>/seed<N>`.
pub fn run_directory(scene: &str, variant: &str, seed: u64) -> PathBuf {
    [scene, variant, &format!("seed{seed}")].iter().collect()
}
