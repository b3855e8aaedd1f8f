use std::hash::Hash;
use std::path::PathBuf;

use indexmap::{IndexMap, IndexSet};
use infonerf_metrics::{METRICS, Values};
use serde::{Deserialize, Deserializer, Serialize, de};

/// Name of the page in a run's folder that shows the scene in 3D; reports open it in place.
pub const VIEWER_PAGE: &str = "viewer.html";

/// One run: an entry of `results.json`, keys in this order.
///
/// A metric that was not computed is `None`, written as `null`, and `notes` says why.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Record {
    /// Name of the experiment, as its configuration file is called.
    pub experiment: String,
    /// Name of the scene.
    pub scene: String,
    /// Variant: what is compared, such as `nerf` and `infonerf`.
    pub variant: String,
    /// Variant of the experiment and values that `variant` stands for, in a run of a sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setting: Option<Setting>,
    /// Seed of the run.
    pub seed: u64,
    /// Name of the preset, such as `fast`, `paper` or `released`.
    pub preset: String,
    /// Device that trained the run.
    pub device: String,
    /// Ids of the training views, in the order given.
    pub train_views: Vec<usize>,
    /// Image files of the training views, paths within the scene's folder; none for built-in scenes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub train_files: Vec<String>,
    /// Views over which the metrics are means.
    pub test_views: TestViews,
    /// Image files of the test views, paths within the scene's folder; none for built-in scenes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub test_files: Vec<String>,
    /// Protocol of the metrics, in words.
    #[serde(default)]
    pub evaluation: String,
    /// Size `[width, height]` of training and test images in pixels.
    pub image_size: [usize; 2],
    /// Number of optimizer steps taken.
    pub iterations: u64,
    /// Wall-clock time of training alone, in seconds, without loading and evaluation.
    pub train_seconds: f64,
    /// Wall-clock time of rendering one test image, in seconds.
    pub render_seconds_per_image: f64,
    /// Number of points along training rays before skipping.
    pub samples_total: u64,
    /// Number of points along training rays at which the field was evaluated.
    pub samples_evaluated: u64,
    /// The metrics of [`METRICS`], a key each: means over the test views.
    #[serde(flatten, deserialize_with = "known_metrics")]
    pub metrics: Values,
    /// Mean entropy of the ray distribution on test rays, in bits (the paper's Figure A).
    pub ray_entropy_bits: Option<f64>,
    /// Mean information gain between test rays and their neighbours (the paper's Figure A).
    pub information_gain: Option<f64>,
    /// Errors of the training cameras; `None` if the true cameras are unknown, or were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cameras: Option<CameraErrors>,
    /// Peak resident memory of the process in bytes, where the system reports it.
    pub peak_rss_bytes: Option<u64>,
    /// Whether the field went empty.
    pub collapsed: bool,
    /// Remarks, among them the reason for each metric that is `null`.
    pub notes: Vec<String>,
}

/// Mean errors of the poses of training cameras, each set aligned with the true ones by a similarity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraErrors {
    /// Angle between the given and the true orientations, degrees.
    pub rotation_deg_before: f64,
    /// Angle between the orientations at the end of training and the true ones, degrees.
    pub rotation_deg: f64,
    /// Distance between the given and the true positions, percent of the distance from the scene's centre.
    pub translation_percent_before: f64,
    /// Distance of the positions at the end of training from the true ones, percent of that from the scene's centre.
    pub translation_percent: f64,
}

/// A variant of an experiment with the values that a sweep gave some keys.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Setting {
    /// Name of the experiment's variant.
    pub variant: String,
    /// Values by dotted key, such as `1e-3` of `loss.entropy.weight`.
    pub values: IndexMap<String, String>,
}

/// The views over which the metrics are means.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TestViews {
    /// Choice of views, such as `all`, or `every-8` for every eighth view.
    pub protocol: String,
    /// Number of views.
    pub count: usize,
    /// Ids of the views.
    pub ids: Vec<usize>,
}

/// Returns the name of a key in columns and charts: the paper's symbol, or the key without its table.
pub(crate) fn short_key(key: &str) -> &str {
    match key {
        "loss.entropy.weight" => "λ₁",
        "loss.kl.weight" => "λ₂",
        key => key.split_once('.').map_or(key, |(_, rest)| rest),
    }
}

/// Returns the distinct values of `key`, in order of appearance.
pub(crate) fn distinct<'a, R: AsRef<Record>, T: Hash + Eq>(records: &'a [R], key: impl Fn(&'a Record) -> T) -> Vec<T> {
    records.iter().map(AsRef::as_ref).map(key).collect::<IndexSet<T>>().into_iter().collect()
}

impl AsRef<Self> for Record {
    fn as_ref(&self) -> &Self {
        self
    }
}

/// Returns the folder of a run below its experiment's: `<scene>/<variant>/seed<N>`.
///
/// A run holds `test/NNN.png` (renders), `truth/NNN.png`, `depth/NNN.png`, `error/NNN.png` and `metrics.jsonl`, each of
/// which may be missing. Images of the same name show the same view.
pub fn run_directory(scene: &str, variant: &str, seed: u64) -> PathBuf {
    [scene, variant, &format!("seed{seed}")].iter().collect()
}

impl Record {
    /// Returns the run's identity: experiment, scene, variant, seed and preset. Saving a record replaces the one of the same key.
    pub fn key(&self) -> (String, String, String, u64, String) {
        (self.experiment.clone(), self.scene.clone(), self.variant.clone(), self.seed, self.preset.clone())
    }

    pub(crate) fn directory(&self) -> PathBuf {
        run_directory(&self.scene, &self.variant, self.seed)
    }

    /// Returns the label of the run, such as `lego / infonerf / seed 0`.
    pub(crate) fn run_label(&self) -> String {
        format!("{} / {} / seed {}", self.scene, self.label(), self.seed)
    }

    /// Returns the label of the variant with its values, such as `infonerf, λ₁ = 1e-3`.
    pub fn label(&self) -> String {
        let Some(Setting { variant, values }) = &self.setting else { return self.variant.clone() };
        values.iter().fold(variant.clone(), |label, (key, value)| format!("{label}, {} = {value}", short_key(key)))
    }

    /// Returns the record without metrics that are NaN or infinite, which JSON lacks; `notes` names them.
    #[must_use]
    pub fn representable(mut self) -> Self {
        let rays = [("ray_entropy_bits", &mut self.ray_entropy_bits), ("information_gain", &mut self.information_gain)];
        let metrics = self.metrics.iter_mut().map(|(key, value)| (key.as_str(), value));
        for (name, metric) in metrics.chain(rays) {
            if let Some(value) = metric.take_if(|value| !value.is_finite()) {
                self.notes.push(format!("{name} was {value} and is left out: JSON cannot hold it"));
            }
        }
        self
    }
}

/// Reads the metrics from the keys that are not fields of a record, in the order of [`METRICS`].
fn known_metrics<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Values, D::Error> {
    let mut others = serde_json::Map::deserialize(deserializer)?;
    let number = |(key, value): (&str, serde_json::Value)| {
        let value = Option::<f64>::deserialize(value).map_err(|error| de::Error::custom(format!("{key}: {error}")))?;
        Ok((key.to_owned(), value))
    };
    METRICS.iter().filter_map(|metric| Some((metric.key(), others.remove(metric.key())?))).map(number).collect()
}
