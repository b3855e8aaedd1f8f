use glam::DMat4;

use crate::{Pixels, SeenPixels};

/// What a step looks at. The trainer draws it, or is given it by [`Trainer::step_on`](crate::Trainer::step_on).
#[derive(Clone, Debug)]
pub struct StepPixels {
    /// Which of the scenes it is of.
    pub scene: usize,
    /// Pixels of training images.
    pub seen: SeenPixels,
    /// Pixels of an unseen pose, if a term needs them.
    pub unseen: Option<Pixels>,
    /// The rotation that takes cameras to those of neighbouring rays.
    pub rotation: DMat4,
}
