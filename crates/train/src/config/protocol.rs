use std::fmt;
use std::str::FromStr;

use infonerf_scene::{SceneError, TestProtocol, ViewSelection};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use toml::Value;

/// Choice of test views, as written in configs: `all`, `split` (the format's own), `every-8`, `first-3`,
/// `0,8,16` (or a list), or a published protocol of the scene's format.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Value", into = "String")]
pub struct TestViewChoice(TestProtocol);

/// Parses a choice of views from a string, a view's id or a list of ids.
fn parse<T: FromStr<Err = SceneError>>(value: &Value) -> Result<T, String> {
    let text = match value {
        Value::String(text) => text.clone(),
        Value::Array(ids) => ids.iter().map(Value::to_string).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    };
    text.parse().map_err(|error| match error {
        SceneError::Request { expected, found, .. } => format!("expected {expected}, found {found}"),
        error => error.to_string(),
    })
}

impl TestViewChoice {
    /// Converts the choice to the loader's type.
    pub fn test(&self) -> TestProtocol {
        self.0.clone()
    }
}

impl FromStr for TestViewChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::try_from(Value::String(text.to_owned()))
    }
}

impl TryFrom<Value> for TestViewChoice {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        parse(&value).map(Self)
    }
}

impl fmt::Display for TestViewChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl From<TestViewChoice> for String {
    fn from(protocol: TestViewChoice) -> Self {
        protocol.to_string()
    }
}

/// Choice of training views: a table of a `kind` with its numbers, or as text `26,86,2,55` (or a list), `all`,
/// `seed-4`, `farthest-4`, `narrow-4/30`, `wide-4` or the name of a published selection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self", tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Views {
    /// `count` views drawn by the run's seed as NumPy would: seed 0 gives 26, 86, 2, 55 of 100.
    Seed {
        /// Number of views.
        count: usize,
    },
    /// The views with these ids.
    Ids {
        /// Indices of training images.
        ids: Vec<usize>,
    },
    /// Farthest-point sampling: the first view drawn by the run's seed, each further one as far away as possible.
    Farthest {
        /// Number of views.
        count: usize,
    },
    /// Views within an angle of each other, drawn by the run's seed.
    Narrow {
        /// Number of views.
        count: usize,
        /// Maximal angle between any two of them, degrees.
        angle_deg: f64,
    },
    /// The set whose nearest two views are farthest apart, among many sets drawn by the run's seed.
    Wide {
        /// Number of views.
        count: usize,
    },
    /// A published selection of the scene's format, such as `regnerf-3` of LLFF and DTU.
    Published {
        /// Name of the selection.
        name: String,
    },
    /// Every training image.
    All,
}

impl Serialize for Views {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Self::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for Views {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let selection = match Value::deserialize(deserializer)? {
            table @ Value::Table(_) => return Self::deserialize(table).map_err(de::Error::custom),
            text if text.as_str().is_some_and(|text| text.contains('@')) => {
                let fault = format!("expected views without a seed, which is the run's, found {text}");
                return Err(de::Error::custom(fault));
            }
            text => parse(&text).map_err(de::Error::custom)?,
        };
        Ok(match selection {
            ViewSelection::Ids(ids) => Self::Ids { ids },
            ViewSelection::Seed { count, .. } => Self::Seed { count },
            ViewSelection::FarthestPoint { count, .. } => Self::Farthest { count },
            ViewSelection::Narrow { count, angle_deg, .. } => Self::Narrow { count, angle_deg },
            ViewSelection::Wide { count, .. } => Self::Wide { count },
            ViewSelection::All => Self::All,
            ViewSelection::Named(name) => Self::Published { name },
        })
    }
}

impl Views {
    /// Returns the number of views; `None` if it depends on the scene.
    pub fn count(&self) -> Option<usize> {
        Some(match self {
            Self::Seed { count } | Self::Farthest { count } | Self::Narrow { count, .. } | Self::Wide { count } => {
                *count
            }
            Self::Ids { ids } => ids.len(),
            Self::Published { .. } | Self::All => return None,
        })
    }

    /// Converts the choice to the loader's type, with the run's seed.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Preset};

    #[test]
    fn views_are_read_from_text_and_lists() {
        let read = |assignment: &str| Config::of(Preset::Paper, [assignment]).map_err(|error| error.to_string());
        let views = |text: &str| read(&format!("scene.views={text}")).unwrap().scene.views;
        for text in ["26,86,2,55", "[26, 86, 2, 55]", "{kind='ids',ids=[26,86,2,55]}"] {
            assert_eq!(views(text), Views::Ids { ids: vec![26, 86, 2, 55] });
        }
        assert_eq!(views("7"), Views::Ids { ids: vec![7] });
        assert_eq!((views("all"), views("seed-3")), (Views::All, Views::Seed { count: 3 }));
        assert_eq!(views("narrow-4/30"), Views::Narrow { count: 4, angle_deg: 30.0 });
        assert_eq!(views("regnerf-3"), Views::Published { name: "regnerf-3".into() });
        for (text, want) in [("0,8", "0,8"), ("[0, 8]", "0,8"), ("3", "3"), ("first-2", "first-2")] {
            assert_eq!(read(&format!("eval.test={text}")).unwrap().eval.test.to_string(), want);
        }
        for (assignment, message) in [
            ("scene.views=4 views", "scene.views: expected `all`, view ids `26,86,2,55`, "),
            (
                "scene.views=seed-4@1",
                "scene.views: expected views without a seed, which is the run's, found \"seed-4@1\"",
            ),
            ("scene.views=1.5", "scene.views: expected `all`, view ids `26,86,2,55`, "),
            (
                "scene.views={kind='best'}",
                "scene.views: expected one of seed, ids, farthest, narrow, wide, published, all, found \"best\"",
            ),
            ("eval.test=some", "eval.test: expected `all`, `split`, "),
            ("eval.test=true", "eval.test: expected `all`, `split`, "),
        ] {
            let found = read(assignment).unwrap_err();
            assert!(found.starts_with(message), "{found}");
        }
    }
}
