//! Radiance fields as Burn modules: from points and directions to density and colour.
//!
//! Density and colour are two calls, so that rays which only need density (the unseen rays of the entropy loss) never
//! pay for colour. To add a field: one file with a module, and one variant in [`FieldConfig`] and [`RadianceField`].

mod activation;
mod config;
mod init;
mod nerf;

pub use activation::DensityActivation;
pub use config::{ConfigError, FieldConfig, NerfConfig};
pub use nerf::NerfMlp;

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
}

/// Density at the points asked for.
#[derive(Clone, Debug)]
pub struct Density {
    /// Volume density σ ≥ 0 in 1/scene unit, `[M]`.
    pub sigma: Tensor<1>,
    /// What the colour head needs, `[M, F]`; its meaning is the field's own.
    pub features: Tensor<2>,
}

/// A function from position and direction to density and colour.
#[derive(Module, Debug)]
pub enum RadianceField {
    /// The MLP of NeRF.
    Nerf(NerfMlp),
}

impl RadianceField {
    /// Builds the field that `config` describes; the same `seed` gives the same weights on every backend.
    ///
    /// # Errors
    /// If a size in `config` is out of range.
    pub fn new(config: &FieldConfig, seed: u64, device: &Device) -> Result<Self, ConfigError> {
        config.validate()?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(match config {
            FieldConfig::Nerf(config) => Self::Nerf(NerfMlp::new(config, &mut rng, device)),
        })
    }

    /// Density σ(x), differentiable in the parameters.
    ///
    /// `progress` ∈ [0, 1] is how far training is, for fields that anneal detail; 1 gives the whole field.
    pub fn density(&self, points: Points<'_>, progress: f32) -> Density {
        match self {
            Self::Nerf(field) => field.density(points, progress),
        }
    }

    /// Colour c(x, d) ∈ [0, 1]³ of the points whose `density` was computed, `[M, 3]`.
    pub fn color(&self, density: &Density, points: Points<'_>) -> Tensor<2> {
        match self {
            Self::Nerf(field) => field.color(density, points),
        }
    }

    /// The device that holds the parameters.
    pub fn device(&self) -> Device {
        match self {
            Self::Nerf(field) => field.device(),
        }
    }
}
