use std::fmt;

use serde::{Deserialize, Serialize};

/// Format of a scene's source. Command lines (feature `clap`) accept the formats of exported built-in scenes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// Made by the program.
    #[default]
    #[cfg_attr(feature = "clap", value(skip))]
    #[serde(skip_deserializing)]
    Procedural,
    /// NeRF's synthetic scenes: `transforms_train.json`.
    Blender,
    /// nerfstudio and instant-ngp: `transforms.json`.
    #[cfg_attr(feature = "clap", value(skip))]
    Transforms,
    /// Forward-facing captures: `poses_bounds.npy`.
    Llff,
    /// A reconstruction of COLMAP.
    #[cfg_attr(feature = "clap", value(skip))]
    Colmap,
    /// DTU as IDR, NeuS or pixelNeRF keep it.
    Dtu,
    /// ZJU-MoCap: `annots.npy`.
    Zju,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Procedural => "procedural",
            Self::Blender => "Blender",
            Self::Transforms => "transforms.json",
            Self::Llff => "LLFF",
            Self::Colmap => "COLMAP",
            Self::Dtu => "DTU",
            Self::Zju => "ZJU-MoCap",
        })
    }
}

/// Background of the scene's content in its images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Backdrop {
    /// One known colour, the scene's `background`, which transparent pixels were composited on.
    #[default]
    Colour,
    /// Unknown: whatever the camera saw.
    Unknown,
}

impl fmt::Display for Backdrop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Colour => "a known colour",
            Self::Unknown => "unknown",
        })
    }
}
