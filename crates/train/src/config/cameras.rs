use infonerf_render::Focal;
use infonerf_schedule::{Fault, RampShape, Schedule};
use serde::{Deserialize, Serialize};

/// Whether and how training cameras are refined.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Means of refinement.
    pub refine: Refine,
    /// Adam's learning rate of the corrections: radians, and shares of the cameras' mean distance from the scene's centre.
    pub lr: Schedule,
    /// Focal lengths that are refined as well.
    pub focal: Focal,
    /// Weight of the mean square of the corrections in the objective, which keeps cameras near their start.
    pub prior: f32,
}

/// Means by which training cameras are refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Refine {
    /// No refinement: cameras stay as they are given.
    #[default]
    None,
    /// Matches between their photographs, before training (`infonerf_dataset::with_refined_cameras`).
    Matches,
    /// The photometric loss: they are learned with the field (BARF, [`infonerf_render::CameraRefinement`]).
    Photometric,
    /// Matches, then the photometric loss.
    Both,
}

impl Refine {
    /// Whether matches refine cameras.
    pub fn is_by_matches(self) -> bool {
        matches!(self, Self::Matches | Self::Both)
    }

    /// Whether cameras are learned with the field.
    pub fn is_photometric(self) -> bool {
        matches!(self, Self::Photometric | Self::Both)
    }
}

impl Default for CameraConfig {
    /// Returns the values of preset `paper`: no refinement.
    fn default() -> Self {
        let curve = RampShape::Exponential;
        let lr = Schedule::Ramp { from: 2e-3, to: 1e-5, start: 0.0, end: 1.0, curve, warmup: 100 };
        Self { refine: Refine::None, lr, focal: Focal::Fixed, prior: 1e-3 }
    }
}

impl CameraConfig {
    pub(super) fn validate(&self) -> Result<(), Fault> {
        Fault::unless_always_within(0.0..=1.0, "lr", &self.lr)?;
        Fault::unless_within(0.0..=1e6, "prior", self.prior.into())
    }
}
