//! Text forms of selections and protocols, for command lines and tables.

use std::fmt;
use std::str::FromStr;

use super::{TestProtocol, ViewSelection};

/// Published protocols of test views; each format knows some of them.
const PUBLISHED: [&str; 4] = ["regnerf", "pixelnerf", "infonerf", "neural-body"];

impl fmt::Display for TestProtocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => write!(f, "all"),
            Self::Split => write!(f, "split"),
            Self::Every(step) => write!(f, "every-{step}"),
            Self::First(count) => write!(f, "first-{count}"),
            Self::Ids(ids) => f.write_str(&list(ids)),
            Self::Published(name) => f.write_str(name),
            Self::Training => f.write_str("training"),
        }
    }
}

impl FromStr for TestProtocol {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let error = || {
            let [names @ .., last] = PUBLISHED;
            let names = names.map(|name| format!("`{name}`")).join(", ");
            let expected = "`all`, `split`, `every-8`, `first-3`, view ids `0,8,16`, `training`";
            format!("expected {expected}, {names} or `{last}`, found `{text}`")
        };
        let positive = |n: &str| n.parse::<usize>().ok().filter(|n| *n > 0).ok_or_else(error);
        match (text, text.split_once('-')) {
            ("all", _) => Ok(Self::All),
            ("split", _) => Ok(Self::Split),
            ("training", _) => Ok(Self::Training),
            (_, Some(("every", step))) => positive(step).map(Self::Every),
            (_, Some(("first", count))) => positive(count).map(Self::First),
            _ if PUBLISHED.contains(&text) => Ok(Self::Published(text.into())),
            _ => ids(text).map(Self::Ids).ok_or_else(error),
        }
    }
}

impl fmt::Display for ViewSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => write!(f, "all"),
            Self::Ids { ids } => f.write_str(&list(ids)),
            Self::Seed { seed, count } => write!(f, "seed-{count}@{seed}"),
            Self::Farthest { count, seed } => write!(f, "farthest-{count}@{seed}"),
            Self::Wide { count, seed } => write!(f, "wide-{count}@{seed}"),
            Self::Narrow { count, angle_deg, seed } => write!(f, "narrow-{count}/{angle_deg}@{seed}"),
            Self::Named { name } => f.write_str(name),
        }
    }
}

impl FromStr for ViewSelection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "`all`, view ids `26,86,2,55`, `seed-4`, `farthest-4`, `wide-4`, `narrow-4/30`, a \
                        selection's name such as `regnerf-3`, or names of images such as `image006,image008`";
        let error = || format!("expected {expected}, found `{text}`");
        if text == "all" {
            return Ok(Self::All);
        }
        if let Some(ids) = ids(text) {
            return Ok(Self::Ids { ids });
        }
        let (rule, stated) = match text.split_once('@') {
            Some((rule, seed)) => (rule, Some(seed.parse::<u64>().map_err(|_| error())?)),
            None => (text, None),
        };
        let seed = stated.unwrap_or(0);
        let count = |n: &str| n.parse::<usize>().ok().filter(|n| *n > 0).ok_or_else(error);
        match (rule.split_once('-'), rule.split_once('/')) {
            (Some(("seed", n)), _) => Ok(Self::Seed { count: count(n)?, seed }),
            (Some(("farthest", n)), _) => Ok(Self::Farthest { count: count(n)?, seed }),
            (Some(("wide", n)), _) => Ok(Self::Wide { count: count(n)?, seed }),
            (Some(("narrow", _)), Some((narrow, angle))) => {
                let angle_deg = angle.parse::<f64>().ok().filter(|a| a.is_finite() && *a > 0.0).ok_or_else(error)?;
                Ok(Self::Narrow { count: count(&narrow["narrow-".len()..])?, angle_deg, seed })
            }
            _ if stated.is_none() && is_name(text) => Ok(Self::Named { name: text.into() }),
            _ => Err(error()),
        }
    }
}

/// Parses ids between commas; returns `None` where `text` is something else.
fn ids(text: &str) -> Option<Vec<usize>> {
    text.split(',').map(|id| id.trim().parse().ok()).collect()
}

fn list(ids: &[usize]) -> String {
    ids.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

/// Returns whether `text` is one or more names between commas: not empty, without white space, the first begins with a letter.
fn is_name(text: &str) -> bool {
    let name = |name: &str| !name.is_empty() && !name.contains(|c: char| c.is_whitespace() || c == '@');
    text.starts_with(char::is_alphabetic) && text.split(',').all(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_round_trip() {
        for text in ["all", "split", "every-8", "first-3", "26,86,2,55", "7", "training", "pixelnerf"] {
            assert_eq!(text.parse::<TestProtocol>().unwrap().to_string(), text);
        }
        let selections = "all 26,86,2,55 seed-4@1 farthest-3@0 wide-4@7 narrow-4/30.5@2 regnerf-3 infonerf-2 \
                          images/IMG_06.jpg,IMG_7";
        for text in selections.split(' ') {
            assert_eq!(text.parse::<ViewSelection>().unwrap().to_string(), text);
        }
        assert_eq!("seed-4".parse::<ViewSelection>().unwrap(), ViewSelection::Seed { seed: 0, count: 4 });
    }

    #[test]
    fn other_texts_are_refused() {
        for text in ["", "every-0", "every-x", "first-", "1,,2", "-1", "Split", "a b"] {
            let error = text.parse::<TestProtocol>().unwrap_err();
            assert!(error.contains(&format!("found `{text}`")), "{error}");
        }
        for text in ["", "seed-0", "seed-x@1", "seed-4@x", "narrow-4/0", "regnerf-3@1", "1,x", "a,,b", "a b"] {
            assert!(text.parse::<ViewSelection>().is_err(), "{text}");
        }
    }
}
