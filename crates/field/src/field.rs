use std::fmt;
use std::path::PathBuf;

use burn::module::{Module, ModuleDisplay};
use burn::tensor::{Device, Tensor};
use infonerf_ops::HostField;
use infonerf_schedule::{Fault, Moment};

use crate::{FieldOutput, Penalty, Points, Sources};

/// A learnable function from position and view direction to density and colour.
///
/// Parameters of a module called `tables` get the learning rate `train.lr` × `train.grid_lr_multiplier`.
pub trait Field: Module + ModuleDisplay + Sync + 'static {
    /// Density σ(x), and colour c(x, d) if `color`, differentiable in the parameters.
    ///
    /// Differentiable in the positions too, with view directions held fixed, if the field's config
    /// [says so](FieldSpec::tracks_positions); otherwise no gradient reaches them.
    ///
    /// `at` is the moment of the run, for fields that anneal detail; at [`Moment::END`] all of it is in use.
    ///
    /// # Panics
    /// May panic if the field needs to be [conditioned](Self::conditioned) and is not.
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput;

    /// The device that holds the parameters.
    fn device(&self) -> Device;

    /// The field at a moment of the run, of positions in scene units and unit directions, without tensors: pictures then
    /// take less time. None where there is no such way.
    fn on_host(&self, _at: Moment) -> Option<HostField> {
        None
    }

    /// The field conditioned on `sources`, its photographs: with everything computed that is shared by all evaluations of a
    /// step or picture, such as an image encoder's features or a decoded volume. Gradients flow through it, and it is
    /// outdated once the parameters change. By default a copy.
    ///
    /// In a training step, `seed` determines random numbers of the field (a latent code); without it there are none, as for
    /// pictures.
    fn conditioned(&self, _sources: &Sources, _seed: Option<u64>) -> Self {
        self.clone()
    }

    /// The penalty of that name on the parameters of a [conditioned](Self::conditioned) field, a scalar `[1]`; none if the
    /// field has no such penalty.
    fn penalty(&self, _name: Penalty) -> Option<Tensor<1>> {
        None
    }
}

/// What a field is built from.
#[derive(Clone, Copy, Debug)]
pub struct FieldSetup<'a> {
    /// Corners of the box that holds the scene, scene units.
    pub bounds: [[f32; 3]; 2],
    /// Seed of the initial weights, the same on every backend.
    pub seed: u64,
    /// Device of the parameters.
    pub device: &'a Device,
    /// The body in the scene, if known.
    pub body: Option<Body<'a>>,
}

/// Vertices of a body, and its frame.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// Positions in the world, scene units.
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

/// The config of a field. `Display` names the field with its sizes: `MLP of 8 layers of 256`.
pub trait FieldSpec: fmt::Display {
    /// The field.
    type Field: Field;

    /// Checks every size.
    ///
    /// # Errors
    /// The first key that is out of range.
    fn validate(&self) -> Result<(), Fault>;

    /// Builds the field with its initial weights.
    ///
    /// # Errors
    /// If a file cannot be used, or `setup` lacks what the field needs.
    fn build(&self, setup: &FieldSetup<'_>) -> Result<Self::Field, Fault>;

    /// Memory of the field.
    fn footprint(&self) -> Footprint;

    /// Whether the coarse and the fine pass share one network.
    fn shares_passes(&self) -> bool {
        false
    }

    /// Whether the field needs samples that are intervals (`render.placement = "interval"`).
    fn needs_intervals(&self) -> bool {
        false
    }

    /// Whether the field is conditioned on any photographs, and so can be trained on many scenes.
    fn sees_photographs(&self) -> bool {
        false
    }

    /// For a field that is conditioned on the first training views in every step: the key within `[field]` of their number,
    /// and the number.
    fn first_photographs(&self) -> Option<(&'static str, usize)> {
        None
    }

    /// Whether the field is attached to a body's vertices, and so needs unwarped space.
    fn needs_body(&self) -> bool {
        false
    }

    /// Whether density and colour are differentiable in [`Points::positions`], as `train.cameras.refine` and normals need.
    fn tracks_positions(&self) -> bool {
        true
    }

    /// The file of initial weights, if the field can read one: its key within `[field]`, and its path, which is empty for
    /// random weights.
    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        None
    }

    /// All files that the field reads, of weights and others; empty paths are unused.
    fn files(&mut self) -> Vec<&mut PathBuf> {
        self.weights_file().into_iter().map(|(_, path)| path).collect()
    }
}

/// Memory of a field, in numbers of four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Parameters.
    pub parameters: u64,
    /// Activations per sample of a training step.
    pub per_sample: u64,
}

impl Footprint {
    /// Of `layers` dense layers of `width`, nearly all of an MLP's.
    pub(crate) fn dense(layers: usize, width: usize) -> Self {
        let (layers, width) = (layers as u64, width as u64);
        Self { parameters: layers * width * width, per_sample: layers * width }
    }
}
