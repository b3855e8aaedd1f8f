use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::DensityActivation;

/// Which field to train, and its sizes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum FieldConfig {
    /// The MLP of NeRF.
    Nerf(NerfConfig),
    /// The MLP of mip-NeRF.
    Mip(MipConfig),
    /// Planes and lines with a tiny MLP.
    Factored(FactoredConfig),
    /// An MLP over features of photographs.
    PixelNerf(PixelNerfConfig),
}

/// Sizes of [`FactoredField`](crate::FactoredField).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FactoredConfig {
    /// Texels along each axis of each level, coarsest first.
    pub resolutions: Vec<usize>,
    /// Features of each plane and line: 2, 4, 8 or 16.
    pub channels: usize,
    /// Octaves of the position's encoding.
    pub octaves: usize,
    /// Hidden layers of the MLP.
    pub layers: usize,
    /// Width of the MLP.
    pub width: usize,
    /// Whether colour depends on the view direction, linearly within its sigmoid.
    pub view_dependent: bool,
    /// s in σ = s·softplus(x + b), over the longest side of the scene's box: the same scene in other units learns alike.
    pub density_scale: f32,
    /// b in σ = s·softplus(x + b): how empty space is before training.
    pub density_bias: f32,
    /// Fraction of training over which the finer levels are faded in, one after another; 0 is off.
    pub anneal: f32,
}

/// Sizes of [`NerfMlp`](crate::NerfMlp).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NerfConfig {
    /// Hidden layers of the trunk (paper: 8).
    pub layers: usize,
    /// Width of the trunk (paper: 256); the view branch has half of it.
    pub width: usize,
    /// The trunk layer, counted from 0, that sees the encoded position again (paper: 5). None if not below `layers`.
    pub skip: usize,
    /// Octaves of the position's encoding (paper: 10).
    pub position_octaves: usize,
    /// Octaves of the direction's encoding (paper: 4).
    pub direction_octaves: usize,
    /// How raw density becomes σ.
    pub density: DensityActivation,
    /// Fraction of training over which the position's octaves are faded in, lowest first (FreeNeRF); 0 is off.
    pub anneal: f32,
}

/// Sizes of [`MipNerf`](crate::MipNerf).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MipConfig {
    /// Hidden layers of the trunk (mip-NeRF: 8).
    pub layers: usize,
    /// Width of the trunk (mip-NeRF: 256); the view branch has half of it.
    pub width: usize,
    /// The trunk layer, counted from 0, that sees the encoded position again (mip-NeRF: 5). None if not below `layers`.
    pub skip: usize,
    /// Octaves of the position's integrated encoding (mip-NeRF: 16).
    pub position_octaves: usize,
    /// Octaves of the direction's encoding (mip-NeRF: 4).
    pub direction_octaves: usize,
    /// Fraction of training over which the position's octaves are faded in, lowest first (FreeNeRF); 0 is off.
    pub anneal: f32,
}

/// Sizes of [`PixelNerf`](crate::PixelNerf).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelNerfConfig {
    /// The image encoder.
    pub encoder: EncoderConfig,
    /// ResNet blocks of the MLP (paper: 5).
    pub blocks: usize,
    /// Blocks after which the views are averaged; features are added before each of them (paper: 3).
    pub pool_after: usize,
    /// Width of the MLP (paper: 512).
    pub width: usize,
    /// Octaves of the position's encoding in view space (paper: 6).
    pub octaves: usize,
    /// ω, the encoding's lowest frequency: sin(2ᵏ ω x), x in scene units (paper: 1.5).
    pub frequency: f32,
    /// How raw density becomes σ.
    pub density: DensityActivation,
}

/// The image encoder of [`PixelNerf`](crate::PixelNerf).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncoderConfig {
    /// Channels of the stem and the first stage, twice as many in each further one (ResNet-34: 64).
    pub width: usize,
    /// Residual blocks of each stage that is read (paper: the first three of ResNet-34, 3, 4 and 6).
    pub blocks: Vec<usize>,
    /// Safetensors file with the weights of torchvision's `resnet34`; empty for random ones.
    pub weights: PathBuf,
}

/// A size or factor out of range.
#[derive(Debug, Error, PartialEq)]
#[error("field.{field}: expected {expected}, found {found}")]
pub struct ConfigError {
    /// The key within `[field]`.
    pub field: &'static str,
    /// What would have been accepted.
    pub expected: &'static str,
    /// What was given.
    pub found: String,
}

fn check(field: &'static str, expected: &'static str, found: impl ToString, good: bool) -> Result<(), ConfigError> {
    if good { Ok(()) } else { Err(ConfigError { field, expected, found: found.to_string() }) }
}

fn check_mlp(layers: usize, width: usize, direction_octaves: usize) -> Result<(), ConfigError> {
    check("layers", "1 to 64", layers, (1..=64).contains(&layers))?;
    check("width", "an even number from 2 to 4096", width, (2..=4096).contains(&width) && width.is_multiple_of(2))?;
    check("direction_octaves", "0 to 20", direction_octaves, direction_octaves <= 20)
}

impl fmt::Display for FieldConfig {
    /// What it is, with its sizes: `MLP of 8 layers of 256`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nerf(c) => write!(f, "MLP of {} layers of {}", c.layers, c.width),
            Self::Mip(c) => write!(f, "mip MLP of {} layers of {}", c.layers, c.width),
            Self::Factored(c) => {
                let finest = c.resolutions.iter().max().copied().unwrap_or(0);
                write!(f, "planes and lines of up to {finest} texels with an MLP of {} layers of {}", c.layers, c.width)
            }
            Self::PixelNerf(c) => {
                let stages = c.encoder.blocks.len();
                write!(f, "ResNet MLP of {} blocks of {} over features of {stages} stages", c.blocks, c.width)
            }
        }
    }
}

impl FieldConfig {
    /// Whether one network serves the coarse and the fine pass; otherwise each pass has its own.
    pub fn shares_passes(&self) -> bool {
        matches!(self, Self::Mip(_))
    }

    /// Checks every size against what the field can be built with.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        match self {
            Self::Nerf(c) => {
                check_mlp(c.layers, c.width, c.direction_octaves)?;
                check("position_octaves", "0 to 20", c.position_octaves, c.position_octaves <= 20)?;
                check("anneal", "0 to 1", c.anneal, (0.0..=1.0).contains(&c.anneal))
            }
            Self::Mip(c) => {
                check_mlp(c.layers, c.width, c.direction_octaves)?;
                let octaves = c.position_octaves;
                check("position_octaves", "1 to 20", octaves, (1..=20).contains(&octaves))?;
                check("anneal", "0 to 1", c.anneal, (0.0..=1.0).contains(&c.anneal))
            }
            Self::Factored(c) => {
                let resolutions = format!("{:?}", c.resolutions);
                let good =
                    (1..=8).contains(&c.resolutions.len()) && c.resolutions.iter().all(|r| (2..=2048).contains(r));
                check("resolutions", "1 to 8 numbers from 2 to 2048", resolutions, good)?;
                check("channels", "2, 4, 8 or 16", c.channels, [2, 4, 8, 16].contains(&c.channels))?;
                check("octaves", "0 to 16", c.octaves, c.octaves <= 16)?;
                check("layers", "0 to 8", c.layers, c.layers <= 8)?;
                check("width", "1 to 256", c.width, (1..=256).contains(&c.width))?;
                check(
                    "density_scale",
                    "above 0, at most 1e6",
                    c.density_scale,
                    c.density_scale > 0.0 && c.density_scale <= 1e6,
                )?;
                check("density_bias", "-50 to 50", c.density_bias, (-50.0..=50.0).contains(&c.density_bias))?;
                check("anneal", "0 to 1", c.anneal, (0.0..=1.0).contains(&c.anneal))
            }
            Self::PixelNerf(c) => {
                let blocks = format!("{:?}", c.encoder.blocks);
                let good = (1..=4).contains(&c.encoder.blocks.len())
                    && c.encoder.blocks.iter().all(|count| (1..=64).contains(count));
                check("encoder.blocks", "1 to 4 numbers from 1 to 64", blocks, good)?;
                check("encoder.width", "1 to 512", c.encoder.width, (1..=512).contains(&c.encoder.width))?;
                check("blocks", "1 to 64", c.blocks, (1..=64).contains(&c.blocks))?;
                let pools = (1..=c.blocks).contains(&c.pool_after);
                check("pool_after", "1 to field.blocks", c.pool_after, pools)?;
                check("width", "1 to 4096", c.width, (1..=4096).contains(&c.width))?;
                check("octaves", "0 to 20", c.octaves, c.octaves <= 20)?;
                let good = c.frequency > 0.0 && c.frequency <= 1e3;
                check("frequency", "above 0, at most 1000", c.frequency, good)
            }
        }
    }
}
