//! The complete description of a run. Presets and experiment files are TOML tables merged into one [`Config`].

mod layers;
mod protocol;
mod renamed;
mod train;
mod weights;

pub use layers::{Preset, assign, merge, parse_assignment};
pub use protocol::{Protocol, Views};
pub(crate) use train::LARGEST_ENSEMBLE;
pub use train::{
    Batch, EarlyStoppingConfig, EnsembleConfig, ErrorSamplingConfig, NeighbourConfig, NeighbourSampling,
    RotationCentre, TrainConfig, Unseen,
};

use infonerf_field::{FieldConfig, FieldSpec};
use infonerf_loss::LossConfig;
use infonerf_render::{Placement, RenderConfig};
use serde::{Deserialize, Serialize};

use crate::TrainError;

/// Everything that a run's numbers depend on, beside the scene's files, the seed and the device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Which views, at which size.
    pub scene: SceneConfig,
    /// The network.
    pub field: FieldConfig,
    /// Sampling and skipping.
    pub render: RenderConfig,
    /// Loss terms and their weights.
    pub loss: LossConfig,
    /// The loop.
    pub train: TrainConfig,
    /// What is measured in the end.
    pub eval: EvalConfig,
}

/// Which views, at which size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// Training views.
    pub views: Views,
    /// Longest side of the images in pixels; 0 for the size that they have (built-in scenes: 200).
    pub size: u32,
    /// Which frame of a film (ZJU-MoCap).
    pub frame: usize,
    /// Colour behind transparent pixels.
    pub background: [f32; 3],
}

/// What is measured in the end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvalConfig {
    /// Which test views.
    pub test: Protocol,
    /// How pictures are measured, by name: one of [`infonerf_metrics::Protocol::NAMED`].
    pub protocol: String,
    /// Test rays for mean entropy and information gain (the paper's Figure A); 0 leaves both out.
    pub information_rays: usize,
}

impl EvalConfig {
    /// How pictures are measured.
    pub fn metric_protocol(&self) -> infonerf_metrics::Protocol {
        infonerf_metrics::Protocol::named(&self.protocol).unwrap_or_default()
    }

    fn validate(&self) -> Result<(), TrainError> {
        let known = infonerf_metrics::Protocol::NAMED.map(|(name, _)| name);
        if known.contains(&self.protocol.as_str()) {
            return Ok(());
        }
        Err(TrainError::config(
            "eval.protocol",
            format!("expected one of {}, found {:?}", known.join(", "), self.protocol),
        ))
    }
}

impl Config {
    /// Reads a complete config from a TOML table, refusing unknown keys and numbers out of range.
    ///
    /// # Errors
    /// One line that names the key and what was expected; for a key of an earlier version, the new one.
    pub fn from_table(table: toml::Table) -> Result<Self, TrainError> {
        renamed::refuse_old_keys(&table)?;
        let config: Self = serde_path_to_error::deserialize(toml::Value::Table(table)).map_err(|error| {
            let (path, message) = (error.path().to_string(), error.into_inner().to_string());
            TrainError::config(path, message.lines().next().unwrap_or_default())
        })?;
        config.validate()?;
        Ok(config)
    }

    /// Checks every number, and that the parts go together.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), TrainError> {
        self.field.validate().map_err(|error| TrainError::Config(error.to_string()))?;
        self.render.validate().map_err(|error| TrainError::Config(error.to_string()))?;
        self.loss.validate().map_err(|error| TrainError::Config(error.to_string()))?;
        self.train.validate()?;
        self.eval.validate()?;
        if self.field.needs_intervals() && self.render.placement != Placement::Interval {
            let cause = format!("expected \"interval\" with a {}: its samples are pieces of cones", self.field);
            return Err(TrainError::config("render.placement", cause));
        }
        let skips = self.render.occupancy.enabled || self.render.clip_to_bounds;
        if skips && self.train.neighbours.sampling == NeighbourSampling::Own && self.needs_neighbours() {
            let cause = "expected \"partner\" with render.occupancy.enabled or render.clip_to_bounds: rays and their \
                         neighbours are paired by index, and skipping leaves them with different numbers of samples";
            return Err(TrainError::config("train.neighbours.sampling", cause));
        }
        Ok(())
    }

    fn needs_neighbours(&self) -> bool {
        let entropy = !self.loss.entropy.weight.is_zero() && self.loss.entropy.neighbours;
        !self.loss.kl.weight.is_zero() || entropy
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
    }

    const MIP: &str =
        "field={kind=\"mip\",layers=2,width=8,skip=0,position_frequencies=4,direction_frequencies=2,detail=1.0}";

    #[test]
    fn a_fault_names_its_key() {
        let fault = |assignment: &str| {
            let mut table = Preset::Paper.table();
            assign(&mut table, assignment).and_then(|()| Config::from_table(table).map(|_| ())).unwrap_err().to_string()
        };
        for (assignment, part) in [
            ("train.rayz=3", "rayz"),
            ("train.rays=-3", "train.rays"),
            ("train.rays=0", "train.rays"),
            ("train.rays=many", "train.rays"),
            ("loss.entropy.weight=nan", "loss.entropy.weight"),
            ("loss.entropy.weight=-1", "loss.entropy.weight"),
            ("loss.entropy.weight={from=0.0}", "loss.entropy.weight"),
            ("loss.kl.epsilon=1", "loss.kl.epsilon"),
            ("field.width=7", "field.width"),
            ("field.kind=cube", "cube"),
            ("scene.views.ids=[1]", "scene.views"),
            ("eval.test=some", "eval.test"),
            ("train.downscale=0.5", "train.downscale"),
            ("train.lr={from=1e-3,to=1e-4,shape=\"cosine\"}", "train.lr"),
            (MIP, "render.placement"),
            ("nonsense", "nonsense"),
            ("a..b=1", "a..b"),
        ] {
            let message = fault(assignment);
            assert!(message.contains(part), "{assignment}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
