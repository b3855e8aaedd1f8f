use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::DensityActivation;

/// Which field to train, and its sizes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum FieldConfig {
    /// The MLP of NeRF.
    Nerf(NerfConfig),
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

impl FieldConfig {
    /// Checks every size against what the field can be built with.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        match self {
            Self::Nerf(c) => {
                check("layers", "1 to 64", c.layers, (1..=64).contains(&c.layers))?;
                check("width", "an even number from 2 to 4096", c.width, (2..=4096).contains(&c.width) && c.width % 2 == 0)?;
                check("position_octaves", "0 to 20", c.position_octaves, c.position_octaves <= 20)?;
                check("direction_octaves", "0 to 20", c.direction_octaves, c.direction_octaves <= 20)?;
                check("anneal", "0 to 1", c.anneal, (0.0..=1.0).contains(&c.anneal))
            }
        }
    }
}
