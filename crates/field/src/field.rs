use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use burn::module::{Module, ModuleDisplay};
use burn::tensor::{Device, Tensor};
use infonerf_ops::HostField;
use infonerf_schedule::{Fault, Moment};

use crate::points::{FieldOutput, Points};

/// A learnable function from position and view direction to density and colour.
///
/// Parameters of a module called `tables` get the learning rate `train.lr` × `train.grid_lr_multiplier`.
pub trait Field: Module + ModuleDisplay + Sync + 'static {
    /// Computes density σ(x), and colour c(x, d) if `color`, differentiable in the parameters.
    ///
    /// Differentiable in the positions too, with view directions held fixed, if the field
    /// [tracks positions](FieldTraits::tracks_positions); otherwise no gradient reaches them.
    ///
    /// `at` is the moment of the run, for fields that anneal detail; at [`Moment::END`] all of it is in use.
    ///
    /// # Panics
    /// May panic if the field needs to be [conditioned](Self::conditioned) and is not.
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput;

    /// Returns the device that holds the parameters: by default that of the module's first tensor.
    fn device(&self) -> Device {
        self.devices().swap_remove(0)
    }

    /// Returns a function of positions in scene units and unit directions that evaluates the field at a moment of the run
    /// without tensors, which makes renders faster; `None` if the field has none.
    fn on_host(&self, _at: Moment) -> Option<HostField> {
        None
    }

    /// Returns a copy of the field conditioned on `sources`: it holds the values that all evaluations of a step or render
    /// share, such as an image encoder's features or a decoded volume. Gradients flow through these values, which are
    /// outdated once the parameters change. By default it is a plain copy.
    ///
    /// In a training step, `seed` determines random numbers of the field (a latent code, noise on density); a render has
    /// none.
    fn conditioned(&self, _sources: &Sources, _seed: Option<u64>) -> Self {
        self.clone()
    }

    /// Computes the penalty of that name on the parameters of a [conditioned](Self::conditioned) field, a scalar `[1]`; `None`
    /// if the field has no such penalty.
    fn penalty(&self, _name: Penalty) -> Option<Tensor<1>> {
        None
    }
}

/// Computes density σ, `[M]`, and its gradient ∂σ/∂x, `[M, 3]`, in 1/unit and 1/unit² of the positions' space; −∂σ/∂x
/// points out of dense regions. The results are in no autodiff graph, and parameters get no gradients.
///
/// The density of a sample depends on its own position alone, so that the gradient of Σσ is the gradient of each. View
/// directions, and the lengths and distances of [`Extent`](crate::Extent), are held fixed.
///
/// `None` if the field does not [track positions](FieldTraits::tracks_positions).
///
/// # Panics
/// As [`Field::evaluate`].
pub fn density_gradient<F: Field>(field: &F, points: &Points, at: Moment) -> Option<(Tensor<1>, Tensor<2>)> {
    let positions = points.positions.clone().inner().autodiff().require_grad();
    let tracked = Points { positions: positions.clone(), ..points.clone() };
    let sigma = field.valid().train().no_grad().evaluate(&tracked, false, at).sigma;
    let gradients = sigma.is_tracked().then(|| sigma.clone().sum().backward())?;
    Some((sigma.inner(), positions.grad(&gradients)?))
}

/// Scene, seed and device that a field is built for.
#[derive(Clone, Copy, Debug)]
pub struct FieldSetup<'a> {
    /// Corners of the box that holds the scene, scene units.
    pub bounds: [[f32; 3]; 2],
    /// Seed of the initial weights, the same on every backend.
    pub seed: u64,
    /// Device of the parameters.
    pub device: &'a Device,
    /// The body in the scene, if known.
    pub body: Option<BodyVertices<'a>>,
}

impl FieldSetup<'_> {
    pub(crate) fn longest_side(&self) -> f32 {
        (0..3).map(|axis| self.bounds[1][axis] - self.bounds[0][axis]).fold(0.0, f32::max)
    }
}

/// Vertices of a body, and its frame.
#[derive(Clone, Copy, Debug)]
pub struct BodyVertices<'a> {
    /// Positions in the world, scene units.
    pub vertices: &'a [[f32; 3]],
    /// Axes of the body's frame in the world.
    pub axes: [[f32; 3]; 3],
    /// Origin of the body's frame in the world.
    pub origin: [f32; 3],
}

impl Default for BodyVertices<'_> {
    /// Returns a body without vertices, whose own frame is the world's.
    fn default() -> Self {
        Self { vertices: &[], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], origin: [0.0; 3] }
    }
}

/// Config of a field. `Display` names the field with its sizes: `MLP of 8 layers of 256`.
pub trait FieldSpec: fmt::Display + Clone {
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

    /// Returns the memory of the field.
    fn footprint(&self) -> Footprint;

    /// Returns the demands of the field on samples, images and space.
    fn traits(&self) -> FieldTraits {
        FieldTraits::default()
    }

    /// Returns the config of the coarse pass's own network; `None` if both passes share one.
    fn coarse(&self) -> Option<Self> {
        Some(self.clone())
    }

    /// Lists the files that the field reads; empty paths are unused.
    fn files(&mut self) -> Vec<FieldFile<'_>> {
        Vec::new()
    }
}

/// Demands of a field on samples, images and space, and whether gradients reach positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldTraits {
    /// Whether samples must be intervals (`render.placement = "interval"`).
    pub intervals: bool,
    /// Images that the field is conditioned on.
    pub sources: SourceImages,
    /// Whether the field is attached to a body's vertices, and so needs unwarped space.
    pub body: bool,
    /// Whether density and colour are differentiable in [`Points::positions`], as `train.cameras.refine` and normals need.
    pub tracks_positions: bool,
}

impl Default for FieldTraits {
    /// Returns the demands of a field of points in any space that is conditioned on no images.
    fn default() -> Self {
        Self { intervals: false, sources: SourceImages::None, body: false, tracks_positions: true }
    }
}

/// Images that a field is conditioned on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceImages {
    /// No images.
    None,
    /// Any images, so that the field can be trained on many scenes.
    Any,
    /// The first training views in every step.
    First {
        /// Key within `[field]` that sets the number of images.
        key: &'static str,
        /// Number of images.
        count: usize,
    },
}

/// A file that a field reads.
#[derive(Debug)]
pub struct FieldFile<'a> {
    /// Key within `[field]`.
    pub key: &'static str,
    /// Path of the file.
    pub path: &'a mut PathBuf,
    /// Whether the file has initial weights, which a trained field does not need; an empty path then means random ones.
    pub holds_weights: bool,
}

/// Memory of a field, in values of four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Parameters.
    pub parameters: u64,
    /// Activations per sample of a training step.
    pub per_sample: u64,
}

impl Footprint {
    /// Returns the memory of `layers` dense layers of `width`, which is nearly all of an MLP's memory.
    pub(crate) fn dense(layers: usize, width: usize) -> Self {
        let (layers, width) = (layers as u64, width as u64);
        Self { parameters: layers * width * width, per_sample: layers * width }
    }
}

/// The name of a penalty on a field's own parameters, such as the total variation of its tables.
///
/// A term of the objective requests it by name from [`Field::penalty`]. The set of names is open: a
/// penalty of a single field is defined next to that field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Penalty(pub &'static str);

impl Penalty {
    /// Total variation of a field's tables (planes and lines, voxels), a mean that each field defines.
    pub const TOTAL_VARIATION: Self = Self("total variation");
}

/// An image that a field is conditioned on, with its camera.
///
/// The camera looks along its −z axis, y up: a point `(X, Y, Z)` of its space, Z < 0, is at the pixel position
/// `(cx − fx·X/Z, cy + fy·Y/Z)`, in which pixel centres are at + 0.5.
#[derive(Clone, Debug)]
pub struct SourceView {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colours in [0, 1], row-major.
    pub rgb: Arc<[[f32; 3]]>,
    /// Focal lengths fx and fy in pixels.
    pub focal: [f32; 2],
    /// Principal point cx, cy in pixels.
    pub centre: [f32; 2],
    /// World to camera: rows of `[R | t]`.
    pub to_camera: [[f32; 4]; 3],
}

/// Images that a field is conditioned on.
#[derive(Clone, Debug)]
pub struct Sources {
    /// Images, at least one, all of one size.
    pub views: Arc<[SourceView]>,
    /// The middle of the scene's box: the origin of positions in a view's axes.
    pub middle: [f32; 3],
}
