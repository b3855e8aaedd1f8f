//! The complete description of a run. Presets and experiment files are TOML tables merged into one [`Config`].

mod layers;
mod protocol;

pub use layers::{Preset, assign, merge, parse_assignment};
pub use protocol::{Protocol, Views};

use std::path::PathBuf;

use infonerf_field::FieldConfig;
use infonerf_loss::{EntropyConfig, GainConfig, Norm, SemanticConfig};
use infonerf_render::{Placement, RenderConfig};
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::members::MOST_MEMBERS;

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
    /// Longest side of the images in pixels; 0 for the size that they have.
    pub size: u32,
    /// Colour behind transparent pixels.
    pub background: [f32; 3],
}

/// Loss terms and their weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossConfig {
    /// L_RGB.
    pub rgb: RgbConfig,
    /// λ₁ L_entropy.
    pub entropy: EntropyConfig,
    /// λ₂ L_KL.
    pub gain: GainConfig,
    /// λ L_SC, DietNeRF's semantic consistency.
    pub semantic: SemanticConfig,
    /// Share of the run at which the entropy and gain terms begin.
    pub start: f64,
    /// Share of the run over which they then rise to their weights; 0 is at once.
    pub ramp: f64,
    /// Penalty on opacity.
    pub opacity: OpacityConfig,
    /// What the known background colour says about opacity.
    pub key: KeyConfig,
    /// Weight of mean (acc − alpha)²: supervision by the alpha channel, which photographs do not have; 0 uses RGB only.
    pub alpha: f32,
    /// Total variation of a field's tables.
    pub variation: VariationConfig,
}

/// Total variation of a field's tables: w · TV, falling exponentially over the run so that detail can come back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VariationConfig {
    /// w at the start.
    pub weight: f32,
    /// The last weight over the first.
    pub last: f32,
}

/// A penalty on mean opacity while shape forms: w · mean(acc), falling linearly to 0.
///
/// White fog before a white background costs nothing in colour, and hides the scene from other views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpacityConfig {
    /// w at the start.
    pub weight: f32,
    /// Share of the run after which it is gone.
    pub until: f64,
}

/// RGB only: a pixel that is exactly the background's colour most likely shows the background, any other an object.
///
/// Adds `background` · acc for the former and −`foreground` · acc for the latter, averaged over the rays. No alpha is
/// used; an object of exactly the background's colour would be thinned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyConfig {
    /// Weight for pixels of the background's colour.
    pub background: f32,
    /// Weight for all others.
    pub foreground: f32,
}

/// The photometric term.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RgbConfig {
    /// How a colour difference becomes a number.
    pub norm: Norm,
    /// Weight of the coarse pass's colour beside the fine one's 1 (NeRF: 1, mip-NeRF: 0.1).
    pub coarse: f32,
}

/// The training loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Steps, unless a time budget decides.
    pub iterations: usize,
    /// Rays of training images a step, |R_s|.
    pub rays: usize,
    /// Rays of unseen poses a step, |R_u|.
    pub unseen_rays: usize,
    /// If above 0: evaluated samples a step to aim for. As space is found empty, a step then takes more rays of both
    /// kinds, in proportion.
    pub samples: usize,
    /// Coarse-to-fine images: `[share, factor]` pairs, images smaller by `factor` until `share` of the run is done.
    pub pyramid: Vec<(f64, u32)>,
    /// Where a step's pixels come from.
    pub batch: Batch,
    /// Whether pixels that are explained already are drawn less.
    pub explained: ExplainedConfig,
    /// Whether a run ends before its time when its error falls no more.
    pub converged: ConvergedConfig,
    /// If above 0: a field that looks at photographs sees at most so many of them in a step, how many and which being
    /// drawn; 0 shows it all.
    pub sources: usize,
    /// Folder of a run whose weights to begin with, such as `infonerf pretrain` leaves; empty for random ones.
    pub init: PathBuf,
    /// Steps in which pixels come from the central half of the images only (released code: 500).
    pub center_steps: usize,
    /// Where unseen poses come from.
    pub unseen: Unseen,
    /// Adam's learning rate at the start.
    pub lr: f64,
    /// How it falls.
    pub lr_decay: Decay,
    /// Steps over which the learning rate rises from 0.
    pub lr_warmup: usize,
    /// Factor on the learning rate of a field's tables.
    pub table_rate: f64,
    /// Adam's β₂ (PyTorch: 0.999).
    pub adam_beta2: f32,
    /// Adam's ε (PyTorch: 1e-8).
    pub adam_epsilon: f32,
    /// Fields trained one after another from other random numbers, whose pictures are averaged; each takes all steps.
    pub members: usize,
    /// With a budget: seconds that each field has, if the budget holds more of them than `members`; 0 leaves it at those.
    pub member_seconds: f64,
    /// Share of the run, at its end, over which weights are averaged for rendering; 0 renders the last ones. For a run of one
    /// field only.
    pub average: f64,
    /// Steps between checkpoints; 0 for one at the end only.
    pub checkpoint_every: usize,
    /// Fresh starts allowed when a field collapses to empty space.
    pub restarts: usize,
}

/// A pixel whose colour was met to within `error` when a step last looked at it is *explained*, and drawn more rarely: the
/// loss is then of what is not explained yet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplainedConfig {
    /// Largest difference of a channel below which a pixel is explained; 0 draws all alike.
    pub error: f32,
    /// How often a draw of an explained pixel counts.
    pub keep: f32,
}

impl ExplainedConfig {
    /// Whether steps need to know what earlier ones met. On a GPU they then read their colours back.
    pub(crate) fn is_on(&self) -> bool {
        self.error > 0.0
    }
}

/// A run ends when its training error over `window` steps is not smaller by a share of `gain` than over those before. Steps
/// with images smaller than the full size (`train.pyramid`) do not count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConvergedConfig {
    /// Steps; 0 takes all that there are.
    pub window: usize,
    /// Relative.
    pub gain: f64,
}

/// Where a step's pixels come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Batch {
    /// Any pixels of all training images.
    Pixels,
    /// Pixels of one training image a step, each at most once, as in the released code.
    Image,
    /// The same, of an image that a field which looks at photographs is not shown in that step, if there is another:
    /// otherwise every ray's colour can be read where the ray starts, whatever its density.
    #[serde(rename = "held-out")]
    HeldOut,
}

/// Where unseen poses come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unseen {
    /// The part of the sphere that the training cameras span; never a test pose.
    Sphere,
    /// The poses of all training images, chosen or not: knowledge of the scene that four photographs do not give.
    Dataset,
}

/// How the learning rate falls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Decay {
    /// By a factor of 10 every so many steps, exponentially (paper: 250,000).
    Steps {
        /// Steps for a factor of 10.
        tenfold: usize,
    },
    /// Exponentially over the run, however long it is.
    Run {
        /// The last learning rate over the first.
        last: f64,
    },
}

impl LossConfig {
    /// Factor on the entropy and gain terms when the run is `progress` ∈ [0, 1] of the way.
    pub fn ramp_at(&self, progress: f64) -> f32 {
        if progress < self.start {
            0.0
        } else if self.ramp > 0.0 {
            ((progress - self.start) / self.ramp).min(1.0) as f32
        } else {
            1.0
        }
    }

    /// Weight of the opacity penalty when the run is `progress` of the way.
    pub fn opacity_at(&self, progress: f64) -> f32 {
        if self.opacity.until > 0.0 {
            self.opacity.weight * (1.0 - progress / self.opacity.until).max(0.0) as f32
        } else {
            0.0
        }
    }
}

impl TrainConfig {
    /// How much smaller images are when the run is `progress` of the way.
    pub fn factor_at(&self, progress: f64) -> u32 {
        self.pyramid.iter().find(|(share, _)| progress < *share).map_or(1, |(_, factor)| *factor)
    }

    /// Learning rate at `step` when the run is `progress` ∈ [0, 1] of the way.
    pub fn lr_at(&self, step: usize, progress: f64) -> f64 {
        let warm = if self.lr_warmup > 0 { ((step + 1) as f64 / self.lr_warmup as f64).min(1.0) } else { 1.0 };
        self.lr
            * warm
            * match self.lr_decay {
                Decay::Steps { tenfold } => 0.1f64.powf(step as f64 / tenfold.max(1) as f64),
                Decay::Run { last } => last.powf(progress),
            }
    }
}

/// What is measured in the end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvalConfig {
    /// Which test views.
    pub test: Protocol,
    /// Test rays for mean entropy and information gain (the paper's Figure A); 0 leaves both out.
    pub information_rays: usize,
}

impl Config {
    /// Reads a complete config from a TOML table, refusing unknown keys and numbers out of range.
    ///
    /// # Errors
    /// One line that names the key and what was expected.
    pub fn from_table(table: toml::Table) -> Result<Self, TrainError> {
        let config: Self = serde_path_to_error::deserialize(toml::Value::Table(table)).map_err(|error| {
            let (path, message) = (error.path().to_string(), error.into_inner().to_string());
            TrainError::config(path, message.lines().next().unwrap_or_default())
        })?;
        config.validate()?;
        Ok(config)
    }

    /// Where the first weights come from, if a reader of the results should know.
    pub fn first_weights(&self) -> Option<String> {
        let init = &self.train.init;
        if !init.as_os_str().is_empty() {
            return Some(format!("began with the weights of {}", init.display()));
        }
        let FieldConfig::PixelNerf(field) = &self.field else { return None };
        let weights = &field.encoder.weights;
        Some(if weights.as_os_str().is_empty() {
            "the image encoder began with random weights, not with ImageNet's".into()
        } else {
            format!("the image encoder began with the weights of {}", weights.display())
        })
    }

    /// The same without need of any file of weights: for a model that is trained already.
    pub fn without_weight_files(&self) -> Self {
        let mut config = self.clone();
        config.train.init = PathBuf::new();
        config.loss.semantic.weight = 0.0;
        if let FieldConfig::PixelNerf(field) = &mut config.field {
            field.encoder.weights = PathBuf::new();
        }
        config
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), TrainError> {
        self.field.validate().map_err(|error| TrainError::Config(error.to_string()))?;
        self.render.validate().map_err(|error| TrainError::Config(error.to_string()))?;
        if matches!(self.field, FieldConfig::Mip(_)) && self.render.placement != Placement::Interval {
            let cause = "expected \"interval\" with field.kind = \"mip\": its samples are pieces of cones";
            return Err(TrainError::config("render.placement", cause));
        }
        let t = &self.train;
        let number = |key: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(TrainError::config(key, format!("expected a number from {low} to {high}, found {value}")))
            }
        };
        number("train.iterations", t.iterations as f64, 1.0, 1e9)?;
        number("train.rays", t.rays as f64, 1.0, 65_536.0)?;
        number("train.unseen_rays", t.unseen_rays as f64, 0.0, 65_536.0)?;
        number("train.samples", t.samples as f64, 0.0, 1e8)?;
        for (share, factor) in &t.pyramid {
            number("train.pyramid", *share, 0.0, 1.0)?;
            number("train.pyramid", f64::from(*factor), 1.0, 64.0)?;
        }
        number("train.explained.error", f64::from(t.explained.error), 0.0, 1.0)?;
        number("train.explained.keep", f64::from(t.explained.keep), 0.0, 1.0)?;
        number("train.converged.window", t.converged.window as f64, 0.0, 1e9)?;
        number("train.converged.gain", t.converged.gain, 0.0, 1.0)?;
        number("train.lr", t.lr, 0.0, 1e3)?;
        number("train.table_rate", t.table_rate, 0.0, 1e6)?;
        number("train.adam_beta2", f64::from(t.adam_beta2), 0.0, 0.999_999)?;
        number("train.adam_epsilon", f64::from(t.adam_epsilon), 0.0, 1.0)?;
        number("train.members", t.members as f64, 1.0, MOST_MEMBERS as f64)?;
        number("train.member_seconds", t.member_seconds, 0.0, 1e9)?;
        number("train.average", t.average, 0.0, 1.0)?;
        if let Decay::Run { last } = t.lr_decay {
            number("train.lr_decay.last", last, 1e-9, 1.0)?;
        }
        number("loss.rgb.coarse", f64::from(self.loss.rgb.coarse), 0.0, 1e6)?;
        number("loss.entropy.weight", f64::from(self.loss.entropy.weight), 0.0, 1e6)?;
        number("loss.entropy.epsilon", f64::from(self.loss.entropy.epsilon), 0.0, 0.01)?;
        number("loss.start", self.loss.start, 0.0, 1.0)?;
        number("loss.ramp", self.loss.ramp, 0.0, 1.0)?;
        number("loss.opacity.weight", f64::from(self.loss.opacity.weight), 0.0, 1e6)?;
        number("loss.opacity.until", self.loss.opacity.until, 0.0, 1.0)?;
        number("loss.key.background", f64::from(self.loss.key.background), 0.0, 1e6)?;
        number("loss.key.foreground", f64::from(self.loss.key.foreground), 0.0, 1e6)?;
        number("loss.alpha", f64::from(self.loss.alpha), 0.0, 1e6)?;
        number("loss.variation.weight", f64::from(self.loss.variation.weight), 0.0, 1e6)?;
        number("loss.variation.last", f64::from(self.loss.variation.last), 1e-9, 1e9)?;
        number("loss.gain.weight", f64::from(self.loss.gain.weight), 0.0, 1e6)?;
        number("loss.semantic.weight", f64::from(self.loss.semantic.weight), 0.0, 1e6)?;
        number("loss.semantic.every", self.loss.semantic.every as f64, 1.0, 1e9)?;
        number("loss.semantic.size", f64::from(self.loss.semantic.size), 1.0, 1024.0)?;
        number("loss.gain.epsilon", f64::from(self.loss.gain.epsilon), 1e-12, 0.01)?;
        number("loss.gain.max_angle_deg", self.loss.gain.max_angle_deg, 0.0, 180.0)
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

    #[test]
    fn learning_rates() {
        let mut train = Config::from_table(Preset::Released.table()).unwrap().train;
        train.lr = 1.0;
        train.lr_warmup = 0;
        train.lr_decay = Decay::Steps { tenfold: 100 };
        assert!((train.lr_at(200, 0.0) - 0.01).abs() < 1e-12);
        train.lr_decay = Decay::Run { last: 0.01 };
        assert!((train.lr_at(7, 0.5) - 0.1).abs() < 1e-12);
    }

    const MIP: &str = "field={kind=\"mip\",layers=2,width=8,skip=0,position_octaves=4,direction_octaves=2,anneal=0.0}";

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
            ("field.width=7", "field.width"),
            ("field.kind=cube", "cube"),
            ("scene.views.ids=[1]", "scene.views"),
            ("eval.test=some", "eval.test"),
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
