use infonerf_ops::sampling::{LastInterval, Placement};
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::warp::SpaceChoice;

/// Config of rendering: sampling of rays, compositing, and skipping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderConfig {
    /// Number of samples per ray of the coarse or only pass. Pictures are rendered with the schedule's value at the last step.
    pub samples: Schedule,
    /// Further samples per ray, drawn from the coarse weights (NeRF: 128); 0 for a single pass.
    pub fine_samples: usize,
    /// Position of a sample within its interval.
    pub placement: Placement,
    /// Length of a ray's last interval.
    pub last_interval: LastInterval,
    /// Compositing of samples.
    pub compositing: Compositing,
    /// Whether space is warped: `auto`, `box` (unchanged), `ndc`, `contraction`.
    pub space: SpaceChoice,
    /// Whether rays are clipped to the scene's box; only in unwarped space.
    pub clip_to_bounds: bool,
    /// Transmittance at which a ray stops in pictures of a single pass with [`Placement::Mid`]; this changes a colour by at
    /// most this value. With a finer grid, steps through thin fog are longer, too (`march.rs`). 0 evaluates all samples.
    pub early_stop_transmittance: f32,
    /// Optical depth, computed from the occupancy grid's densities, behind which training and the reported entropy and
    /// information gain skip samples; 0 skips none, as does a run without a grid. The grid's densities are maxima over cells,
    /// and a ray may miss the matter that they represent: 16 is a safe value. Pictures evaluate hidden samples.
    pub hidden_depth: f32,
    /// Whether pictures add the residuals of the training views nearest to them: [`Residuals`](crate::Residuals).
    #[serde(default)]
    pub residuals: bool,
    /// Skipping of empty space.
    pub occupancy: OccupancyConfig,
}

/// Compositing: the weights w of a ray's samples from their optical depths τ = σδ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Compositing {
    /// wᵢ = Tᵢ (1 − e^−τᵢ): each sample absorbs a share of the light that reaches it (NeRF).
    Exponential,
    /// wᵢ = min(Aᵢ + τᵢ, 1) − Aᵢ with Aᵢ = Σ_{j<i} wⱼ: each sample adds its depth until the ray is full (Neural Volumes).
    Additive,
}

/// An occupancy grid (Instant-NGP, Sec. E; nerfacc).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccupancyConfig {
    /// Whether samples in empty cells are skipped.
    pub enabled: bool,
    /// Cells along each axis of the scene's box.
    pub resolution: usize,
    /// Steps before the first update; nothing is skipped until then.
    pub warmup: usize,
    /// Steps between updates.
    pub every: usize,
    /// Opacity of a sample below which the cell counts as empty.
    pub alpha_threshold: f32,
    /// Factor on a cell's density per update.
    pub decay: f32,
    /// Factor on the resolution for pictures, whose grid is made from the trained field; 1 uses the grid of training.
    pub refine: usize,
}

impl Default for RenderConfig {
    /// Returns the values of preset `paper`.
    fn default() -> Self {
        Self {
            samples: 64.0.into(),
            fine_samples: 128,
            placement: Placement::Left,
            last_interval: LastInterval::Finite,
            compositing: Compositing::Exponential,
            space: SpaceChoice::Auto,
            clip_to_bounds: false,
            early_stop_transmittance: 0.0,
            hidden_depth: 0.0,
            residuals: false,
            occupancy: OccupancyConfig::default(),
        }
    }
}

impl Default for OccupancyConfig {
    /// Returns the values of preset `paper`: no grid.
    fn default() -> Self {
        Self { enabled: false, resolution: 64, warmup: 500, every: 50, alpha_threshold: 0.01, decay: 0.8, refine: 1 }
    }
}

impl OccupancyConfig {
    /// Returns the density at which a sample of `step_length` has opacity `alpha_threshold`.
    pub(crate) fn threshold(&self, step_length: f32) -> f32 {
        -(-self.alpha_threshold).ln_1p() / step_length
    }

    fn validate(&self) -> Result<(), Fault> {
        check("occupancy.resolution", "2 to 512", self.resolution, (2..=512).contains(&self.resolution))?;
        let fine = (1..=8).contains(&self.refine) && self.refine * self.resolution <= 1024;
        check("occupancy.refine", "1 to 8, at most 1024 cells per axis", self.refine, fine)?;
        check("occupancy.every", "1 or more", self.every, self.every >= 1)?;
        let threshold = self.alpha_threshold;
        check("occupancy.alpha_threshold", "above 0, below 1", threshold, threshold > 0.0 && threshold < 1.0)?;
        check("occupancy.decay", "0 to 1", self.decay, (0.0..=1.0).contains(&self.decay))
    }
}

/// Returns a fault at `key` of `[render]` with the value `found` unless `good` is true.
fn check(key: &str, expected: &str, found: impl ToString, good: bool) -> Result<(), Fault> {
    Fault::unless(good, key, expected, found).map_err(|fault| fault.within("render"))
}

impl RenderConfig {
    /// Checks every number and combination.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), Fault> {
        let (least, largest) = (self.samples.least(), self.samples.largest());
        check("samples", "2 to 4096", format!("{least} to {largest}"), least >= 2.0 && largest <= 4096.0)?;
        check("fine_samples", "0 to 4096", self.fine_samples, self.fine_samples <= 4096)?;
        let enough = self.fine_samples == 0 || least >= 4.0;
        check("fine_samples", "0, or samples >= 4 to draw from", self.fine_samples, enough)?;
        let applies = self.last_interval == LastInterval::Finite || self.placement == Placement::Left;
        check("last_interval", "\"finite\" unless render.placement = \"left\"", "\"infinite\"", applies)?;
        let stop = self.early_stop_transmittance;
        check("early_stop_transmittance", "0 up to, not including, 1", stop, (0.0..1.0).contains(&stop))?;
        check("hidden_depth", "0 or more", self.hidden_depth, self.hidden_depth >= 0.0)?;
        self.occupancy.validate()
    }

    /// Returns one line for each key that is set but has no effect, given the other keys.
    pub fn without_effect(&self) -> Vec<&'static str> {
        let stop = (self.early_stop_transmittance > 0.0 && !self.marches()).then_some(
            "render.early_stop_transmittance has no effect on pictures with render.fine_samples or without \
             render.placement = \"mid\"",
        );
        let hidden = (self.hidden_depth > 0.0 && !self.occupancy.enabled)
            .then_some("render.hidden_depth has no effect without render.occupancy.enabled");
        stop.into_iter().chain(hidden).collect()
    }

    /// Whether a coarse pass places the samples of a fine one.
    pub fn is_hierarchical(&self) -> bool {
        self.fine_samples > 0
    }

    /// Whether a single pass has steps of one length: pictures are then composited front to back and rays stop early.
    pub fn marches(&self) -> bool {
        self.placement == Placement::Mid && !self.is_hierarchical()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_allowed_and_values_beyond_them_refused() {
        type Set = fn(&mut RenderConfig, f32);
        let numbers: [(&str, Set, [f32; 2], &[f32]); 10] = [
            ("samples", |config, x| config.samples = f64::from(x).into(), [4.0, 4096.0], &[1.0, 4097.0]),
            ("fine_samples", |config, x| config.fine_samples = x as usize, [0.0, 4096.0], &[4097.0]),
            ("fine_samples", |config, x| config.samples = f64::from(x).into(), [4.0, 5.0], &[3.0]),
            ("early_stop_transmittance", |config, x| config.early_stop_transmittance = x, [0.0, 0.999], &[-0.1, 1.0]),
            ("hidden_depth", |config, x| config.hidden_depth = x, [0.0, 9.0], &[-0.1]),
            ("occupancy.resolution", |config, x| config.occupancy.resolution = x as usize, [2.0, 512.0], &[1.0, 513.0]),
            ("occupancy.refine", |config, x| config.occupancy.refine = x as usize, [1.0, 8.0], &[0.0, 9.0]),
            ("occupancy.every", |config, x| config.occupancy.every = x as usize, [1.0, 99.0], &[0.0]),
            ("occupancy.alpha_threshold", |config, x| config.occupancy.alpha_threshold = x, [0.01, 0.99], &[0.0, 1.0]),
            ("occupancy.decay", |config, x| config.occupancy.decay = x, [0.0, 1.0], &[-0.1, 1.1]),
        ];
        for (key, set, good, bad) in numbers {
            let refused = |value| {
                let mut config = RenderConfig::default();
                set(&mut config, value);
                config.validate().err().map(|fault| fault.key)
            };
            assert_eq!(good.map(refused), [None, None], "{key}");
            assert!(bad.iter().all(|&value| refused(value) == Some(format!("render.{key}"))), "{key}");
        }
    }

    #[test]
    fn keys_without_effect_are_named() {
        let named = |change: fn(&mut RenderConfig)| {
            let mut config =
                RenderConfig { early_stop_transmittance: 1e-3, hidden_depth: 16.0, ..RenderConfig::default() };
            change(&mut config);
            let lines = config.without_effect().into_iter();
            lines.map(|line| line.split(' ').next().unwrap_or_default()).collect::<Vec<_>>()
        };
        let (stop, hidden) = ("render.early_stop_transmittance", "render.hidden_depth");
        assert_eq!(RenderConfig::default().without_effect(), Vec::<&str>::new());
        assert_eq!(named(|config| config.placement = Placement::Mid), [stop, hidden]);
        assert_eq!(named(|config| config.fine_samples = 0), [stop, hidden]);
        assert_eq!(named(|config| (config.placement, config.fine_samples) = (Placement::Mid, 0)), [hidden]);
        assert_eq!(named(|config| config.occupancy.enabled = true), [stop]);
    }
}
