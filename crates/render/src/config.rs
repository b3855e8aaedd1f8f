use infonerf_schedule::Schedule;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::Space;

/// How rays are sampled and what is skipped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderConfig {
    /// Samples along a ray: of the coarse pass, or of the only one where `fine_samples` is 0. A schedule changes it over
    /// the run; pictures are rendered with its last value.
    pub samples: Schedule,
    /// Further samples drawn where the coarse pass found something (NeRF: 128); 0 for a single pass.
    pub fine_samples: usize,
    /// Where in its interval a sample is evaluated.
    pub placement: Placement,
    /// How long a ray's last interval is.
    pub last_interval: LastInterval,
    /// How samples make up a ray.
    pub compositing: Compositing,
    /// Whether samples are jittered within their intervals in training.
    pub jitter: bool,
    /// Whether space is taken as it is, or brought into a box: `auto`, `box`, `ndc`, `contraction`.
    pub space: Space,
    /// Whether rays are cut to the box that holds the scene; only where space is taken as it is.
    pub clip_to_bounds: bool,
    /// In pictures: transmittance below which the rest of a ray is not evaluated. Exact up to this much; 0 evaluates
    /// everything.
    pub early_stop_transmittance: f32,
    /// In training: optical depth, as the occupancy grid remembers it, behind which the rest of a ray is taken to be hidden
    /// and is skipped; 0 skips nothing. The grid remembers maxima, so this is no transmittance: 16 is a safe value.
    pub hidden_depth: f32,
    /// Skipping of empty space.
    pub occupancy: OccupancyConfig,
}

/// Where in its interval a sample is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// At the near end, as in NeRF: stratified distances, and interval i reaches from sample i to sample i + 1.
    Left,
    /// In the middle. A single pass takes steps of one length, whatever the ray's.
    Mid,
    /// Over all of it, as a field of volumes needs (mip-NeRF): `samples + 1` edges bound `samples` intervals, and the fine
    /// pass has `fine_samples` intervals of its own, drawn from blurred weights and not merged with the coarse ones.
    Interval,
}

/// Length of a ray's last interval under [`Placement::Left`]; elsewhere an interval ends where the ray does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LastInterval {
    /// As long as the one before it.
    Finite,
    /// 1e10, as in the released code: any density there gives α ≈ 1.
    Infinite,
}

/// How the optical depths τ = σδ of a ray's samples become weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Compositing {
    /// wᵢ = Tᵢ (1 − e^−τᵢ): each sample absorbs a share of what reaches it (NeRF).
    Exponential,
    /// wᵢ = min(Aᵢ + τᵢ, 1) − Aᵢ with Aᵢ = Σ_{j<i} wⱼ: each sample adds its depth until the ray is full (Neural Volumes).
    Additive,
}

/// An occupancy grid that remembers where there is something (Instant-NGP, Sec. E; nerfacc).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccupancyConfig {
    /// Whether samples in empty cells are skipped.
    pub enabled: bool,
    /// Cells along each axis of the scene's box.
    pub resolution: usize,
    /// Steps before anything is skipped: until then the field knows nothing.
    pub warmup: usize,
    /// Steps between updates.
    pub every: usize,
    /// A cell is empty while the opacity of one sample in it stays below this.
    pub alpha_threshold: f32,
    /// Factor on a cell's remembered density at each update.
    pub decay: f32,
    /// For pictures: how many times finer along each axis a grid is made from the finished field; 1 uses the grid of
    /// training.
    pub refine: usize,
    /// Whether cells that the alpha channel of a training view shows to be background are empty for good; RGB images carve
    /// nothing.
    pub carve: bool,
}

impl OccupancyConfig {
    /// The density at which one sample of `step_length` has opacity `alpha_threshold`.
    pub(crate) fn threshold(&self, step_length: f32) -> f32 {
        -(-self.alpha_threshold).ln_1p() / step_length
    }

    fn validate(&self) -> Result<(), ConfigError> {
        check("occupancy.resolution", "2 to 512", self.resolution, (2..=512).contains(&self.resolution))?;
        let fine = (1..=8).contains(&self.refine) && self.refine * self.resolution <= 1024;
        check("occupancy.refine", "1 to 8, at most 1024 cells per axis", self.refine, fine)?;
        check("occupancy.every", "1 or more", self.every, self.every >= 1)?;
        let threshold = self.alpha_threshold;
        check("occupancy.alpha_threshold", "above 0, below 1", threshold, threshold > 0.0 && threshold < 1.0)?;
        check("occupancy.decay", "0 to 1", self.decay, (0.0..=1.0).contains(&self.decay))
    }
}

/// A number out of range.
#[derive(Debug, Error, PartialEq)]
#[error("render.{field}: expected {expected}, found {found}")]
pub struct ConfigError {
    field: &'static str,
    expected: &'static str,
    found: String,
}

fn check(
    field: &'static str,
    expected: &'static str,
    found: impl std::fmt::Display,
    good: bool,
) -> Result<(), ConfigError> {
    if good { Ok(()) } else { Err(ConfigError { field, expected, found: found.to_string() }) }
}

impl RenderConfig {
    /// Checks every number, and that the options go together.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
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

    /// Whether a coarse pass tells a fine one where to look.
    pub fn is_hierarchical(&self) -> bool {
        self.fine_samples > 0
    }

    /// Whether a single pass takes steps of one length: pictures then go front to back and stop where nothing more is seen.
    pub(crate) fn marches(&self) -> bool {
        self.placement == Placement::Mid && !self.is_hierarchical()
    }
}
