use std::fmt;
use std::str::FromStr;

use infonerf_scene::{TestProtocol, ViewSelection};
use serde::{Deserialize, Serialize};

/// Which test views to evaluate on, as written in configs: `all`, `every-8`, `first-3`.
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
        let number = |prefix| text.strip_prefix(prefix).and_then(|n: &str| n.parse::<usize>().ok()).filter(|n| *n > 0);
        match text {
            "all" => Ok(Self(TestProtocol::All)),
            _ => number("every-")
                .map(TestProtocol::Every)
                .or_else(|| number("first-").map(TestProtocol::First))
                .map(Self)
                .ok_or_else(|| format!("expected `all`, `every-8` or `first-3`, found `{text}`")),
        }
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
        match &self.0 {
            TestProtocol::All => write!(f, "all"),
            TestProtocol::Every(n) => write!(f, "every-{n}"),
            TestProtocol::First(n) => write!(f, "first-{n}"),
            TestProtocol::Ids(ids) => write!(f, "ids {ids:?}"),
        }
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
    /// Every training image.
    All,
}

impl Views {
    /// For the loader, with the run's seed.
    pub fn select(&self, seed: u64) -> ViewSelection {
        match self.clone() {
            Self::Seed { count } => ViewSelection::Seed { seed, count },
            Self::Ids { ids } => ViewSelection::Ids(ids),
            Self::Farthest { count } => ViewSelection::FarthestPoint { count, seed },
            Self::Narrow { count, angle_deg } => ViewSelection::Narrow { count, angle_deg, seed },
            Self::Wide { count } => ViewSelection::Wide { count, seed },
            Self::All => ViewSelection::All,
        }
    }
}
