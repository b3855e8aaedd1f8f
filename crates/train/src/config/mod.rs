//! Complete description of a run, and its [`checks`]: presets and experiment files, merged as TOML tables into a [`Config`].

pub mod checks;
mod layers;
mod read;
mod train;
mod views;

pub use layers::{Preset, assign, merge, parse_assignment};
pub use read::plain_message;
pub use train::{
    Batch, CameraConfig, EnsembleConfig, NeighbourConfig, NeighbourSampling, Refine, RotationCentre, TrainConfig,
    Unseen,
};

use std::path::PathBuf;

use infonerf_field::{FieldConfig, FieldFile, FieldSpec};
use infonerf_loss::LossConfig;
use infonerf_render::RenderConfig;
use infonerf_scene::{Format, MaskUse, TestProtocol, ViewSelection};
use infonerf_schedule::{Fault, Schedule, is_default};
use serde::{Deserialize, Serialize};

use crate::error::TrainError;

/// Everything that the results of a run depend on, except the scene's files, the seed and the device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Scene: choice of views and their size.
    pub scene: SceneConfig,
    /// Field: kind and sizes of the network.
    pub field: FieldConfig,
    /// Sampling and skipping.
    pub render: RenderConfig,
    /// Loss terms and their weights.
    pub loss: LossConfig,
    /// Training: the optimization loop.
    pub train: TrainConfig,
    /// Evaluation: measurements at the end of a run.
    pub eval: EvalConfig,
}

/// Scene: choice of views and their size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// Training views, drawn by the run's seed: a table of a `kind` with its numbers, or as text `26,86,2,55` (or a list),
    /// `all`, `seed-4`, `farthest-4`, `narrow-4/30`, `wide-4` or the name of a published selection.
    #[serde(deserialize_with = "views::training_views")]
    pub views: ViewSelection,
    /// Longest side of the images in pixels; 0 for the size that they have (built-in scenes: 200).
    pub size: u32,
    /// Index of the frame of a film (ZJU-MoCap).
    pub frame: usize,
    /// Colour behind transparent pixels.
    pub background: [f32; 3],
    /// Position within a pixel through which its ray passes, in training and in pictures.
    pub pixel_position: PixelPosition,
    /// Format of a folder that fits several formats; by default the first of these.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<Format>,
    /// Use of the black pixels of a capture's masks (`mask_path` of `transforms.json`).
    #[serde(default, skip_serializing_if = "is_default")]
    pub masks: MaskUse,
    /// Disturbance of the poses of training cameras before training, for experiments.
    #[serde(default, skip_serializing_if = "is_default")]
    pub disturb: Disturbance,
}

/// Disturbance of the training cameras from their true poses, drawn by the run's seed ([`infonerf_scene::Scene::disturbed`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Disturbance {
    /// Angle of each camera's rotation about its centre.
    pub degrees: f64,
    /// Length of each camera's move, as a share of its distance from the scene's centre.
    pub distance: f64,
}

/// Position within a pixel through which its ray passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelPosition {
    /// Through the pixel's centre, (i + 0.5, j + 0.5), as cameras take photographs.
    Centre,
    /// Through the pixel's top left corner, (i, j), as in the released code.
    Corner,
}

/// Evaluation: measurements at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvalConfig {
    /// Test views: `all`, `split` (the format's own), `every-8`, `first-3`, `0,8,16` (or a list), `training`, or a published
    /// protocol of the scene's format.
    #[serde(serialize_with = "views::as_text", deserialize_with = "views::test_views")]
    pub test: TestProtocol,
    /// Name of the protocol by which pictures are measured, one of [`infonerf_metrics::Protocol::NAMED`].
    pub protocol: String,
    /// Test rays for mean entropy and information gain (the paper's Figure A); 0 leaves both out.
    pub information_rays: usize,
    /// Steps that fit each test view's pose before it is measured (BARF, [`crate::fit_test_poses`]); 0 for none.
    #[serde(default, skip_serializing_if = "is_default")]
    pub pose_steps: usize,
    /// Maximal number of test views that are measured, spread evenly over all; 0 for all of them.
    #[serde(default, skip_serializing_if = "is_default")]
    pub max_views: usize,
}

impl EvalConfig {
    /// Returns the protocol by which pictures are measured.
    pub fn metric_protocol(&self) -> infonerf_metrics::Protocol {
        infonerf_metrics::Protocol::named(&self.protocol).unwrap_or_default()
    }

    /// Returns the test `views` that are measured.
    pub fn measured<'a, T>(&self, views: &'a [T]) -> Vec<&'a T> {
        let step = if self.max_views == 0 { 1 } else { views.len().div_ceil(self.max_views).max(1) };
        views.iter().step_by(step).collect()
    }
}

impl Config {
    /// Makes the config of a preset with keys changed by `settings`, each `dotted.key=value`.
    ///
    /// # Errors
    /// As [`assign`] and [`Self::from_table`].
    pub fn of(preset: Preset, settings: impl IntoIterator<Item: AsRef<str>>) -> Result<Self, TrainError> {
        let mut table = preset.table();
        settings.into_iter().try_for_each(|setting| assign(&mut table, setting.as_ref()))?;
        Self::from_table(table)
    }

    /// Reads a complete config from a TOML table, refusing unknown keys and numbers out of range.
    ///
    /// # Errors
    /// One line that names the key and what was expected.
    pub fn from_table(table: toml::Table) -> Result<Self, TrainError> {
        let config = read::config(table)?;
        config.check()?;
        Ok(config)
    }

    /// Checks every number and the consistency of all parts, as [`Self::from_table`] does: for configs that were changed since.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn check(&self) -> Result<(), Fault> {
        checks::check_config(self)
    }

    /// Describes the origin of the initial weights, if a reader of the results should know it.
    pub fn initial_weights(&self) -> Option<String> {
        let init = &self.train.init;
        if !init.as_os_str().is_empty() {
            return Some(format!("initial weights from {}", init.display()));
        }
        let mut field = self.field.clone();
        let FieldFile { key, path, .. } = field.files().into_iter().find(|file| file.holds_weights)?;
        Some(if path.as_os_str().is_empty() {
            format!("field.{key}: random weights, not published ones")
        } else {
            format!("field.{key}: initial weights from {}", path.display())
        })
    }

    /// Returns the config without files of weights, for a model that is trained already.
    pub fn without_weight_files(&self) -> Self {
        let mut config = self.clone();
        config.train.init = PathBuf::new();
        for file in config.field.files().into_iter().filter(|file| file.holds_weights) {
            *file.path = PathBuf::new();
        }
        for (_, spec) in config.loss.specs_mut() {
            if spec.weights_file().is_some() {
                *spec.weight_mut() = Schedule::Constant(0.0);
            }
        }
        config
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_complete() {
        for preset in Preset::ALL {
            Config::from_table(preset.table()).unwrap();
        }
        let paper = Config::from_table(Preset::Paper.table()).unwrap();
        assert_eq!(paper.render, RenderConfig::default());
        assert_eq!(paper.train.cameras, CameraConfig::default());
    }

    #[test]
    fn measured_views_are_spread_evenly() {
        let measured = |max_views: usize| {
            let config = Config::of(Preset::Paper, [format!("eval.max_views={max_views}")]).unwrap();
            config.eval.measured(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]).into_iter().copied().collect::<Vec<_>>()
        };
        assert_eq!((measured(3), measured(1), measured(5)), (vec![0, 4, 8], vec![0], vec![0, 2, 4, 6, 8]));
        assert_eq!((measured(0).len(), measured(10).len(), measured(99).len()), (10, 10, 10));
    }

    const ENCODED: &str = "field={kind='neuralvolumes',latent=4,resolution=4,width=8,maps=1,warp_resolution=2,\
                           encoder={images=3,size=[16,16],width=1}}";

    /// Requirements of an encoder of images on the rest of the config.
    #[test]
    fn encoder_sees_its_images_in_every_step() {
        let with = |set: &str| Config::of(Preset::Paper, [ENCODED, set]).map(drop).map_err(|error| error.to_string());
        for fine in ["train.batch=image", "scene.views.count=3", "scene.views={kind='all'}"] {
            assert_eq!(with(fine), Ok(()));
        }
        for (assignment, parts) in [
            ("scene.views.count=2", ["field.encoder.images: expected at most 2", "found 3"]),
            ("scene.views={kind='ids',ids=[1]}", ["field.encoder.images: expected at most 1", "found 3"]),
            ("train.sources=2", ["train.sources: expected 0", "4³ voxels"]),
            ("train.batch=held-out", ["train.batch: expected", "4³ voxels"]),
            ("field.encoder.size=[16,20]", ["field.encoder.size: expected two multiples of 16", "[16, 20]"]),
            ("field.encoder.images=0", ["field.encoder.images: expected 1 to 16", "found 0"]),
        ] {
            let message = with(assignment).unwrap_err();
            assert!(parts.iter().all(|part| message.contains(part)), "{assignment}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
