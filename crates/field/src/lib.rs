//! Radiance fields as Burn modules: from points and directions to density and colour.
//!
//! Rays which only need density (the unseen rays of the entropy loss) say so and never pay for colour. To add a field: one file with a module, and one variant in [`FieldConfig`] and [`RadianceField`].

mod activation;
mod anneal;
mod config;
mod factored;
mod init;
mod mip;
mod mlp;
mod nerf;
mod pixel;
mod sources;

pub use activation::DensityActivation;
pub use config::{ConfigError, EncoderConfig, FactoredConfig, FieldConfig, MipConfig, NerfConfig, PixelNerfConfig};
pub use factored::FactoredField;
pub use mip::MipNerf;
pub use nerf::NerfMlp;
pub use pixel::PixelNerf;
pub use sources::{SourceView, Sources};

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use infonerf_ops::Segments;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Where a field is asked, on the host.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// Sample positions in scene units, `[M, 3]` row-major.
    pub positions: &'a [f32],
    /// Unit view direction of each ray, `[R, 3]` row-major.
    pub directions: &'a [f32],
    /// Which samples belong to which ray.
    pub segments: &'a Segments,
    /// How much space around its position each sample stands for.
    pub extent: Extent<'a>,
}

/// How much space a sample stands for. A field of points ignores it, a field of volumes takes its mean there.
#[derive(Clone, Copy, Debug)]
pub enum Extent<'a> {
    /// Pieces of the cones around the rays: sample `i`, at distance `t[i]`, is the middle of an interval of length
    /// `delta[i]`.
    Cones {
        /// Distance of each sample along its ray, `[M]`, scene units.
        t: &'a [f32],
        /// Length of each sample's interval, `[M]`, scene units.
        delta: &'a [f32],
        /// Radius of each ray's cone at distance 1, `[R]`.
        radii: &'a [f32],
    },
    /// The same ball around each position, for points that are on no ray.
    Ball {
        /// Variance along each axis, scene units².
        variance: f32,
    },
}

/// What a field answers.
#[derive(Clone, Debug)]
pub struct Sampled {
    /// Volume density σ ≥ 0 in 1/scene unit, `[M]`.
    pub sigma: Tensor<1>,
    /// Colour in [0, 1]³ (mip-NeRF: up to 0.001 beyond), `[M, 3]`; none if it was not asked for.
    pub color: Option<Tensor<2>>,
}

/// A function from position and direction to density and colour.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant, reason = "a model holds one or two of them")]
pub enum RadianceField {
    /// The MLP of NeRF.
    Nerf(NerfMlp),
    /// The MLP of mip-NeRF.
    Mip(MipNerf),
    /// Planes and lines with a tiny MLP.
    Factored(FactoredField),
    /// An MLP over features of photographs.
    PixelNerf(PixelNerf),
}

impl RadianceField {
    /// Builds the field that `config` describes; the same `seed` gives the same weights on every backend.
    ///
    /// `bounds` are the corners of the box that holds the scene, for fields that need one.
    ///
    /// # Errors
    /// If a size in `config` is out of range, or a file of weights that it names cannot be used.
    pub fn new(config: &FieldConfig, bounds: [[f32; 3]; 2], seed: u64, device: &Device) -> Result<Self, ConfigError> {
        config.validate()?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(match config {
            FieldConfig::Nerf(config) => Self::Nerf(NerfMlp::new(config, &mut rng, device)),
            FieldConfig::Mip(config) => Self::Mip(MipNerf::new(config, &mut rng, device)),
            FieldConfig::Factored(config) => Self::Factored(FactoredField::new(config, bounds, &mut rng, device)),
            FieldConfig::PixelNerf(config) => Self::PixelNerf(PixelNerf::new(config, &mut rng, device)?),
        })
    }

    /// The field as it answers when it looks at `sources`: needed before [`Self::evaluate`] by a field that
    /// is conditioned on photographs, and nothing but a copy for any other.
    ///
    /// What the field reads from the photographs is computed here, once for all that is then asked; gradients flow back
    /// through it into this field's parameters. It is stale once they change.
    ///
    /// # Panics
    /// If a field that needs photographs is given none.
    pub fn conditioned(&self, sources: &Sources) -> Self {
        match self {
            Self::PixelNerf(field) => Self::PixelNerf(field.conditioned(sources)),
            other => other.clone(),
        }
    }

    /// Density σ(x), and colour c(x, d) if `color`, differentiable in the parameters.
    ///
    /// `progress` ∈ [0, 1] is how far training is, for fields that anneal detail; 1 gives the whole field.
    ///
    /// # Panics
    /// If the field needs photographs and was not [conditioned](Self::conditioned) on any.
    pub fn evaluate(&self, points: Points<'_>, color: bool, progress: f32) -> Sampled {
        match self {
            Self::Nerf(field) => field.evaluate(points, color, progress),
            Self::Mip(field) => field.evaluate(points, color, progress),
            Self::Factored(field) => field.evaluate(points, color, progress),
            Self::PixelNerf(field) => field.evaluate(points, color),
        }
    }

    /// Total variation of the field's tables, a scalar; none for a field without tables.
    pub fn variation(&self) -> Option<Tensor<1>> {
        match self {
            Self::Nerf(_) | Self::Mip(_) | Self::PixelNerf(_) => None,
            Self::Factored(field) => Some(field.variation()),
        }
    }

    /// The device that holds the parameters.
    pub fn device(&self) -> Device {
        match self {
            Self::Nerf(field) => field.device(),
            Self::Mip(field) => field.device(),
            Self::Factored(field) => field.device(),
            Self::PixelNerf(field) => field.device(),
        }
    }
}
