//! Weight files that a config names.

use std::path::PathBuf;

use infonerf_field::{FieldFile, FieldSpec};
use infonerf_schedule::Schedule;

use super::Config;

impl Config {
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
                *spec.weight_mut() = Schedule::constant(0.0);
            }
        }
        config
    }
}
