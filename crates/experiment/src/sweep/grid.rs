//! `--grid dotted.key=value,value`.

use anyhow::{Context, Result, bail};
use infonerf_train::config;
use serde::Deserialize;
use toml::{Spanned, Value};

use super::keys::Key;

/// A key of the config and the values that it takes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Grid {
    pub(super) key: Key,
    /// As written.
    pub(super) values: Vec<String>,
}

impl Grid {
    pub(super) fn parse(text: &str) -> Result<Self> {
        let context = || format!("--grid {text}");
        let (path, _) = config::parse_assignment(text).with_context(context)?;
        let (_, list) = text.split_once('=').with_context(context)?;
        let values = split(list).with_context(context)?;
        if values.iter().any(String::is_empty) {
            bail!("--grid {text}: expected values separated by commas, found an empty one");
        }
        for (index, value) in values.iter().enumerate() {
            if values[..index].contains(value) {
                bail!("--grid {text}: {value} is given twice");
            }
        }
        Ok(Self { key: Key { flag: "--grid", path }, values })
    }

    /// The value at `index` as a number, where it is one.
    pub(super) fn number(&self, index: usize) -> Option<f64> {
        self.values.get(index)?.parse::<f64>().ok().filter(|number| number.is_finite())
    }

    /// `key=value`.
    pub(super) fn assignment(&self, index: usize) -> String {
        let value = self.values.get(index).map_or("", String::as_str);
        format!("{}={value}", self.key)
    }
}

/// The elements of a list, as written. Arrays, tables and quoted strings may hold commas of their own.
fn split(list: &str) -> Result<Vec<String>> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Listed {
        values: Vec<Spanned<Value>>,
    }
    if !list.contains(['[', '{', '"', '\'']) {
        return Ok(list.split(',').map(|value| value.trim().to_owned()).collect());
    }
    let text = format!("values = [{list}]");
    let listed = toml::from_str::<Listed>(&text).map_err(|error| {
        anyhow::anyhow!("expected values separated by commas: {}", error.message().lines().next().unwrap_or_default())
    })?;
    let mut values: Vec<String> = listed.values.iter().map(|value| text[value.span()].to_owned()).collect();
    if list.trim_end().ends_with(',') {
        values.push(String::new());
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        format!("{:#}", Grid::parse(text).unwrap_err())
    }

    #[test]
    fn values_are_kept_as_written() {
        let grid = Grid::parse("loss.entropy.weight=0, 1e-4,1e-3").unwrap();
        assert_eq!(
            (grid.key.to_string().as_str(), &grid.values[..]),
            ("loss.entropy.weight", &["0", "1e-4", "1e-3"].map(str::to_owned)[..])
        );
        assert_eq!(grid.number(1), Some(1e-4));
        let grid = Grid::parse("train.lr=1e-3,{ from = 1e-3, to = 1e-4 }").unwrap();
        assert_eq!(grid.values, ["1e-3", "{ from = 1e-3, to = 1e-4 }"]);
        assert_eq!(Grid::parse("train.unseen=sphere,\"dataset\"").unwrap_err().to_string().lines().count(), 1);
        assert_eq!(Grid::parse("train.unseen=sphere,dataset").unwrap().values, ["sphere", "dataset"]);
    }

    #[test]
    fn bad_grids() {
        assert!(fault("a.b").contains("a.b"));
        for empty in ["a.b=", "a.b=1,,2", "a.b=1,", "a.b=[1],"] {
            assert!(fault(empty).contains("an empty one"), "{empty}");
        }
        assert!(fault("a..b=1").contains("a..b"));
        assert!(fault("a.b=1,2,1").contains("1 is given twice"));
        assert!(fault("a.b=[1").contains("--grid a.b=[1"));
    }
}
