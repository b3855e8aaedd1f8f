use infonerf_render::Focal;
use infonerf_schedule::{Curve, Fault, Schedule};
use serde::{Deserialize, Serialize};

/// Whether and how training cameras are learnt with the field: see [`infonerf_render::CameraRefinement`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Whether they are.
    pub refine: bool,
    /// Adam's learning rate of the corrections: radians, and shares of the cameras' mean distance from the scene's centre.
    pub lr: Schedule,
    /// Which focal lengths are learnt too.
    pub focal: Focal,
    /// Weight of the mean square of the corrections in the objective: a pull towards where the cameras began.
    pub prior: f32,
}

impl Default for CameraConfig {
    /// Off; as preset `paper` has it.
    fn default() -> Self {
        let curve = Curve::Exponential { from: 2e-3, to: 1e-5, start: 0.0, end: 1.0 };
        Self { refine: false, lr: Schedule { curve, warmup: 100 }, focal: Focal::Fixed, prior: 1e-3 }
    }
}

impl CameraConfig {
    pub(super) fn validate(&self) -> Result<(), Fault> {
        Fault::unless_always_within(0.0..=1.0, "lr", &self.lr)?;
        Fault::unless_within(0.0..=1e6, "prior", self.prior.into())
    }
}
