use std::fmt;
use std::path::PathBuf;

use burn::module::{Module, ModuleDisplay};
use burn::tensor::{Device, Tensor};
use infonerf_schedule::Moment;

use crate::{ConfigError, Points, Sampled, Sources};

/// A function from position and view direction to density and colour, with parameters to learn.
///
/// Parameters of a module called `tables` get the learning rate `train.lr` × `train.grid_lr_multiplier`.
pub trait Field: Module + ModuleDisplay + Sync + 'static {
    /// Density σ(x), and colour c(x, d) if `color`, differentiable in the parameters.
    ///
    /// `at` is the moment of the run, for fields that anneal detail; [`Moment::END`] gives the whole field.
    ///
    /// # Panics
    /// May do so if the field computes something ahead and was not [conditioned](Self::conditioned).
    fn evaluate(&self, points: Points<'_>, color: bool, at: Moment) -> Sampled;

    /// The device that holds the parameters.
    fn device(&self) -> Device;

    /// The field as it answers when it looks at `sources`, the photographs that it is conditioned on.
    ///
    /// What a field computes once for all queries of a step or picture (an image encoder's features, a decoded volume) is
    /// computed here; gradients flow back through it. It is stale once the parameters change. Most fields have nothing to
    /// compute ahead, and this is a copy.
    ///
    /// In a training step, `seed` decides what the field draws at random (a latent code); without it the field is as
    /// pictures show it.
    fn conditioned(&self, _sources: &Sources, _seed: Option<u64>) -> Self {
        self.clone()
    }

    /// Total variation of the field's tables, a scalar, of a [conditioned](Self::conditioned) field; none for a field without
    /// tables.
    fn total_variation(&self) -> Option<Tensor<1>> {
        None
    }

    /// Divergence of the latent code of a [conditioned](Self::conditioned) field from a standard normal distribution, a scalar;
    /// none for a field without one.
    fn latent_divergence(&self) -> Option<Tensor<1>> {
        None
    }
}

/// What a field is built for.
#[derive(Clone, Copy, Debug)]
pub struct FieldSetup<'a> {
    /// Corners of the box that holds the scene, scene units.
    pub bounds: [[f32; 3]; 2],
    /// Decides the first weights: the same ones on every backend.
    pub seed: u64,
    /// Where the parameters live.
    pub device: &'a Device,
    /// The body in the scene, if it is known.
    pub body: Option<Body<'a>>,
}

/// Vertices on a body, and the frame that it is posed in.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// In the world, scene units.
    pub vertices: &'a [[f32; 3]],
    /// Axes of the body's frame in the world.
    pub axes: [[f32; 3]; 3],
    /// Origin of the body's frame in the world.
    pub origin: [f32; 3],
}

impl Default for Body<'_> {
    /// No vertices, in the world's own frame.
    fn default() -> Self {
        Self { vertices: &[], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], origin: [0.0; 3] }
    }
}

/// What a config file says of a field. `Display` names it with its sizes: `MLP of 8 layers of 256`.
pub trait FieldSpec: fmt::Display {
    /// The field that it describes.
    type Field: Field;

    /// Checks every size.
    ///
    /// # Errors
    /// The first key that is out of range.
    fn validate(&self) -> Result<(), ConfigError>;

    /// The field with its first weights.
    ///
    /// # Errors
    /// If a file is named that cannot be used, or the field needs what `setup` does not have.
    fn build(&self, setup: &FieldSetup<'_>) -> Result<Self::Field, ConfigError>;

    /// How much memory the field takes.
    fn footprint(&self) -> Footprint;

    /// Whether one network serves the coarse and the fine pass; otherwise each pass has its own.
    fn shares_passes(&self) -> bool {
        false
    }

    /// Whether samples have to be intervals (`render.placement = "interval"`), as a field of volumes needs.
    fn needs_intervals(&self) -> bool {
        false
    }

    /// Whether the field looks at whatever photographs it is shown, and so can learn from many scenes.
    fn sees_photographs(&self) -> bool {
        false
    }

    /// The key within `[field]`, and how many, of a field that looks at the first of the training views and at the same ones in
    /// every step.
    fn first_photographs(&self) -> Option<(&'static str, usize)> {
        None
    }

    /// Whether the field hangs on a body's vertices, and so is asked for points of the world as they are.
    fn needs_body(&self) -> bool {
        false
    }

    /// The file that the first weights are read from, if the field can read one: its key within `[field]`, and its path,
    /// which is empty for random weights.
    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        None
    }

    /// Every file that the field begins with, of weights and others; empty paths are not used.
    fn files(&mut self) -> Vec<&mut PathBuf> {
        self.weights_file().into_iter().map(|(_, path)| path).collect()
    }
}

/// Memory that a field takes, in numbers of four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Parameters.
    pub parameters: u64,
    /// Activations that a training step holds for each sample.
    pub per_sample: u64,
}
