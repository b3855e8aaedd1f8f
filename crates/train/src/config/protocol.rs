use std::fmt;
use std::str::FromStr;

use infonerf_scene::{TestProtocol, ViewSelection};
use serde::{Deserialize, Serialize};

/// Which test views to evaluate on, as written in configs: `all`, `split` (the format's own), `every-8`, `first-3`,
/// `0,8,16`, or a published protocol of the scene's format.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Protocol(TestProtocol);

impl Protocol {
    /// For the loader.
    pub fn test(&self) -> TestProtocol {
        self.0.clone()
    }
}

impl FromStr for Protocol {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.parse().map(Self).map_err(|error: infonerf_scene::SceneError| error.to_string())
    }
}

impl TryFrom<String> for Protocol {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl From<Protocol> for String {
    fn from(protocol: Protocol) -> Self {
        protocol.to_string()
    }
}

/// Which training views to learn from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Views {
    /// `count` views drawn by the run's seed as NumPy would: seed 0 gives 26, 86, 2, 55 of 100.
    Seed {
        /// How many.
        count: usize,
    },
    /// These.
    Ids {
        /// Indices of training images.
        ids: Vec<usize>,
    },
    /// The first drawn by the run's seed, each further one as far as can be from those before.
    Farthest {
        /// How many.
        count: usize,
    },
    /// Views within an angle of each other, drawn by the run's seed.
    Narrow {
        /// How many.
        count: usize,
        /// Largest angle between any two of them, degrees.
        angle_deg: f64,
    },
    /// Of many sets that the run's seed draws the one whose nearest two views are farthest apart.
    Wide {
        /// How many.
        count: usize,
    },
    /// A published selection of the scene's format, such as `regnerf-3` of LLFF and DTU.
    Published {
        /// Its name.
        name: String,
    },
    /// Every training image.
    All,
}

impl Views {
    /// How many they are, where that does not depend on the scene.
    pub(super) fn count(&self) -> Option<usize> {
        match self {
            Self::Seed { count } | Self::Farthest { count } | Self::Narrow { count, .. } | Self::Wide { count } => {
                Some(*count)
            }
            Self::Ids { ids } => Some(ids.len()),
            Self::Published { .. } | Self::All => None,
        }
    }

    /// For the loader, with the run's seed.
    pub fn select(&self, seed: u64) -> ViewSelection {
        match self.clone() {
            Self::Seed { count } => ViewSelection::Seed { seed, count },
            Self::Ids { ids } => ViewSelection::Ids(ids),
            Self::Farthest { count } => ViewSelection::FarthestPoint { count, seed },
            Self::Narrow { count, angle_deg } => ViewSelection::Narrow { count, angle_deg, seed },
            Self::Wide { count } => ViewSelection::Wide { count, seed },
            Self::Published { name } => ViewSelection::Named(name),
            Self::All => ViewSelection::All,
        }
    }
}
