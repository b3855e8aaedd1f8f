use std::path::PathBuf;

use glam::DVec3;
use infonerf_render::Focal;
use infonerf_scene::ViewRegion;
use infonerf_schedule::{Fault, RampShape, Schedule, is_default};
use serde::{Deserialize, Serialize};

/// Max number of fields: further ones improve little, and each costs as much as the others.
pub(crate) const MAX_ENSEMBLE: usize = 8;

/// The training loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Number of steps, unless there is a time budget.
    pub iterations: usize,
    /// Rays of training images per step, |R_s|.
    pub rays: usize,
    /// Rays of unseen poses per step, |R_u|.
    pub unseen_rays: usize,
    /// Target number of evaluated samples per step; as more space is known to be empty, steps take more rays. 0 for no target.
    pub target_samples: usize,
    /// Factor, rounded, by which training images are downscaled; coarse-to-fine if it falls over the run.
    pub downscale: Schedule,
    /// Source of a step's pixels.
    pub batch: Batch,
    /// Maximum number of source images shown to an image-conditioned field in a step, drawn at random; 0 shows all.
    pub sources: usize,
    /// Folder of a run whose weights are the initial weights, such as `infonerf pretrain` leaves; empty for random
    /// weights. A run with `exposure_compensation` does not qualify, as its gains belong to its own views.
    pub init: PathBuf,
    /// Steps in which pixels come from the central half of the images only (released code: 500).
    pub precrop_steps: usize,
    /// Source of unseen poses.
    pub unseen: Unseen,
    /// Neighbours of rays.
    pub neighbours: NeighbourConfig,
    /// Whether each training view has a learned gain and bias per channel ([`infonerf_render::Exposure`]).
    pub exposure_compensation: bool,
    /// Refinement of training cameras.
    #[serde(default, skip_serializing_if = "is_default")]
    pub cameras: CameraConfig,
    /// Adam's learning rate.
    pub lr: Schedule,
    /// Factor on the learning rate of a field's tables.
    pub grid_lr_multiplier: f64,
    /// Adam's β₂ (PyTorch: 0.999).
    pub adam_beta2: f32,
    /// Adam's ε (PyTorch: 1e-8).
    pub adam_epsilon: f32,
    /// Ensemble of several fields of one scene.
    pub ensemble: EnsembleConfig,
    /// Share of the run, at its end, over which weights are averaged for rendering; 0 renders the last ones. For a run of
    /// one field only: the pictures of an ensemble are averaged instead.
    pub weight_averaging: f64,
    /// Steps between checkpoints; 0 for one at the end only.
    pub checkpoint_every: usize,
    /// Fresh starts allowed when a field collapses to empty space.
    pub restarts: usize,
}

/// Source of a step's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Batch {
    /// Any pixels of all training images.
    Pixels,
    /// Pixels of one training image per step, each at most once, as in the released code.
    Image,
    /// Pixels of one training image per step, which an image-conditioned field is not given in that step, if there is
    /// another: otherwise it could copy the colour of each ray from that image, whatever the density.
    #[serde(rename = "held-out")]
    HeldOut,
}

/// Source of unseen poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unseen {
    /// The part of the sphere that the training cameras span; never a test pose.
    Sphere,
    /// Poses of all training images, selected or not, which reveal more of the scene than the selected images. The
    /// released code draws test poses as well, which are never drawn here.
    Dataset,
}

/// Neighbouring rays: the same pixels of cameras that are rotated by three angles, drawn once per step for all rays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeighbourConfig {
    /// Maximal rotation about each axis of the world, degrees (paper: 5).
    pub max_angle_deg: f64,
    /// Centre of the rotation of cameras.
    pub about: RotationCentre,
    /// Placement of samples along neighbouring rays.
    pub sampling: NeighbourSampling,
}

/// Point about which the cameras of neighbouring rays are rotated, position and orientation alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RotationCentre {
    /// The point that the training cameras look at.
    Centre,
    /// The origin of the world, as in the released code.
    Origin,
}

/// Placement of samples along neighbouring rays, which are paired by index with those of the partner ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NeighbourSampling {
    /// At the distances of the partner's samples, so that pairs by index are pairs by distance.
    Partner,
    /// Placed for the neighbouring ray itself, as in the released code.
    Own,
}

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

/// An ensemble: fields that differ in their random numbers alone, each taking all steps, whose pictures are averaged. A CPU
/// trains as many side by side as it has cores, other devices one after another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnsembleConfig {
    /// Number of fields.
    pub size: usize,
    /// Seconds per field under a time budget: the number of fields is budget/seconds if that exceeds `size`. 0 keeps to `size`.
    pub seconds_per_member: f64,
    /// Max number of steps of a field under a time budget, as longer runs fit the noise of few photographs. 0 for no limit.
    pub max_steps: usize,
    /// Max number of steps per training view, where that is more than `max_steps`.
    pub max_steps_per_view: usize,
}

impl RotationCentre {
    /// Returns the point in the world, given the region that the training cameras span.
    pub(crate) fn of(self, region: &ViewRegion) -> DVec3 {
        match self {
            Self::Origin => DVec3::ZERO,
            Self::Centre => region.centre(),
        }
    }
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
    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_always_within(0.0..=1.0, "lr", &self.lr)?;
        Fault::unless_within(0.0..=1e6, "prior", self.prior)
    }
}

impl EnsembleConfig {
    /// Returns the number of fields of a run: `size`, or as many as `seconds_per_member` allows in `budget` seconds if more.
    pub fn members(&self, budget: Option<f64>) -> usize {
        let seconds = self.seconds_per_member;
        let affordable = budget.filter(|_| seconds > 0.0).map_or(0, |budget| (budget / seconds) as usize);
        self.size.max(affordable.min(MAX_ENSEMBLE))
    }

    /// Returns the max number of steps of a field that learns `views` under a time budget, if there is one.
    pub(crate) fn step_limit(&self, views: usize) -> Option<usize> {
        (self.max_steps > 0).then(|| self.max_steps.max(self.max_steps_per_view * views))
    }
}

impl TrainConfig {
    /// Returns the config of each of `members` fields. With several fields weights are not averaged over the end of the
    /// run: the mean of their pictures reduces the same noise, and the fields stay sharper.
    pub fn of_member(&self, members: usize) -> Self {
        let weight_averaging = if members > 1 { 0.0 } else { self.weight_averaging };
        Self { weight_averaging, ..self.clone() }
    }

    /// Returns 1 and every whole factor between the extremes of `downscale`.
    pub(crate) fn downscale_factors(&self) -> impl Iterator<Item = u32> {
        let [least, largest] = [self.downscale.least(), self.downscale.largest()].map(|factor| factor.round() as u32);
        std::iter::once(1).chain(least.max(2)..=largest)
    }

    pub(super) fn validate(&self) -> Result<(), Fault> {
        let within = |fault: Fault| fault.within("train");
        let number = |key, value, low, high| Fault::unless_within(low..=high, key, value).map_err(within);
        let schedule = |key, value, low, high| Fault::unless_always_within(low..=high, key, value).map_err(within);
        number("iterations", self.iterations as f64, 1.0, 1e9)?;
        number("rays", self.rays as f64, 1.0, 65_536.0)?;
        number("unseen_rays", self.unseen_rays as f64, 0.0, 65_536.0)?;
        number("target_samples", self.target_samples as f64, 0.0, 1e8)?;
        schedule("downscale", &self.downscale, 1.0, 64.0)?;
        number("neighbours.max_angle_deg", self.neighbours.max_angle_deg, 0.0, 180.0)?;
        self.cameras.validate().map_err(|fault| within(fault.within("cameras")))?;
        schedule("lr", &self.lr, 0.0, 1e3)?;
        number("grid_lr_multiplier", self.grid_lr_multiplier, 0.0, 1e6)?;
        Fault::unless_within(0.0..=0.999_999, "adam_beta2", self.adam_beta2).map_err(within)?;
        Fault::unless_within(1e-15..=1.0, "adam_epsilon", self.adam_epsilon).map_err(within)?;
        number("ensemble.size", self.ensemble.size as f64, 1.0, MAX_ENSEMBLE as f64)?;
        number("ensemble.seconds_per_member", self.ensemble.seconds_per_member, 0.0, 1e9)?;
        number("ensemble.max_steps", self.ensemble.max_steps as f64, 0.0, 1e9)?;
        number("ensemble.max_steps_per_view", self.ensemble.max_steps_per_view as f64, 0.0, 1e6)?;
        number("weight_averaging", self.weight_averaging, 0.0, 1.0)
    }
}
