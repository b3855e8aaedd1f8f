use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How rays are sampled and what is skipped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderConfig {
    /// Samples along a ray: of the coarse network, or of the only one where `fine_samples` is 0.
    pub samples: usize,
    /// Samples along a ray at the start of training, rising geometrically to `samples` until half of it; 0 for as many.
    /// For a field without a coarse network.
    pub samples_start: usize,
    /// Further samples drawn where the coarse pass saw something (NeRF: 128); 0 for a single pass.
    pub fine_samples: usize,
    /// Where in its interval a sample is evaluated.
    pub placement: Placement,
    /// How long a ray's last interval is.
    pub last_interval: LastInterval,
    /// Whether samples are jittered within their intervals in training.
    pub jitter: bool,
    /// Whether rays are cut to the box that holds the scene.
    pub clip_to_bounds: bool,
    /// In pictures: transmittance below which the rest of a ray is not evaluated. Exact up to this much; 0 evaluates
    /// everything.
    pub min_transmittance: f32,
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
    /// At the near end, as in NeRF: interval i reaches from sample i to sample i + 1.
    Left,
    /// In the middle.
    Mid,
    /// Over all of it, as a field of volumes needs (mip-NeRF): `samples + 1` edges bound `samples` intervals, and the fine
    /// pass has `fine_samples` intervals of its own, drawn from blurred weights and not merged with the coarse ones.
    Interval,
}

/// Length of a ray's last interval under [`Placement::Left`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LastInterval {
    /// As long as the one before it.
    Finite,
    /// 1e10, as in the released code: any density there gives α ≈ 1.
    Infinite,
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
    pub min_alpha: f32,
    /// Factor on a cell's remembered density at each update.
    pub decay: f32,
    /// For pictures: how many times finer along each axis a grid is made from the finished field; 1 uses the grid of training.
    pub refine: usize,
    /// Whether cells that a training view's alpha channel shows to be background are empty for good; RGB images carve
    /// nothing.
    pub carve: bool,
}

impl OccupancyConfig {
    /// The density at which one sample of `step_length` has opacity `min_alpha`.
    pub(crate) fn threshold(&self, step_length: f32) -> f32 {
        -(-self.min_alpha).ln_1p() / step_length
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

impl RenderConfig {
    /// Checks every number.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let check = |field, expected, found: String, good| {
            if good { Ok(()) } else { Err(ConfigError { field, expected, found }) }
        };
        let o = &self.occupancy;
        check("samples", "2 to 4096", self.samples.to_string(), (2..=4096).contains(&self.samples))?;
        check(
            "samples_start",
            "0 or 2 to 4096",
            self.samples_start.to_string(),
            self.samples_start == 0 || (2..=4096).contains(&self.samples_start),
        )?;
        check("fine_samples", "0 to 4096", self.fine_samples.to_string(), self.fine_samples <= 4096)?;
        check(
            "fine_samples",
            "0, or samples >= 4 to draw from",
            self.fine_samples.to_string(),
            self.fine_samples == 0 || self.samples >= 4,
        )?;
        check(
            "min_transmittance",
            "0 up to, not including, 1",
            self.min_transmittance.to_string(),
            (0.0..1.0).contains(&self.min_transmittance),
        )?;
        check("hidden_depth", "0 or more", self.hidden_depth.to_string(), self.hidden_depth >= 0.0)?;
        check("occupancy.resolution", "2 to 512", o.resolution.to_string(), (2..=512).contains(&o.resolution))?;
        check(
            "occupancy.refine",
            "1 to 8, at most 1024 cells an axis",
            o.refine.to_string(),
            (1..=8).contains(&o.refine) && o.refine * o.resolution <= 1024,
        )?;
        check("occupancy.every", "1 or more", o.every.to_string(), o.every >= 1)?;
        check(
            "occupancy.min_alpha",
            "above 0, below 1",
            o.min_alpha.to_string(),
            o.min_alpha > 0.0 && o.min_alpha < 1.0,
        )?;
        check("occupancy.decay", "0 to 1", o.decay.to_string(), (0.0..=1.0).contains(&o.decay))
    }
}
