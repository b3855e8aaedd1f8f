//! `--grid dotted.key=value,value`: the values that a sweep combines.

use anyhow::{Context, Result, bail, ensure};
use infonerf_train::config;
use serde::Deserialize;
use toml::{Spanned, Value};

/// Grids of the paper's two weights: λ₁ around the paper's 1e-3, λ₂ around the released code's 2e-5, and each also 0.
pub const PAPER_SPACE: [&str; 2] = ["loss.entropy.weight=0,1e-4,1e-3,1e-2", "loss.kl.weight=0,2e-6,2e-5,2e-4"];

/// Maximum number of settings of a sweep; a larger number is taken for a mistake.
const MAX_SETTINGS: usize = 100_000;

/// A key of the config and the values that it takes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Grid {
    path: Vec<String>,
    /// Values as they are written.
    pub(super) values: Vec<String>,
}

impl Grid {
    /// Parses grids. Returns an error if two of them, or one and an assignment of `set`, set the same key or a part of it.
    pub(super) fn parse_all(texts: &[String], set: &[String]) -> Result<Vec<Self>> {
        let grids = texts.iter().map(|text| Self::parse(text)).collect::<Result<Vec<_>>>()?;
        for (index, grid) in grids.iter().enumerate() {
            let key = grid.key();
            match grids[..index].iter().find(|other| overlap(&other.path, &grid.path)) {
                Some(other) if other.path == grid.path => bail!("--grid {key}: given twice"),
                Some(other) => bail!("--grid {key}: contradicts --grid {}", other.key()),
                None => {}
            }
            for assignment in set {
                let (path, _) = config::parse_assignment(assignment).with_context(|| format!("--set {assignment}"))?;
                ensure!(!overlap(&path, &grid.path), "--set {assignment}: contradicts --grid {key}");
            }
        }
        Ok(grids)
    }

    fn parse(text: &str) -> Result<Self> {
        let context = || format!("--grid {text}");
        let (path, _) = config::parse_assignment(text).with_context(context)?;
        let (_, list) = text.split_once('=').with_context(context)?;
        let values = split(list).with_context(context)?;
        let is_whole = !values.iter().any(String::is_empty);
        ensure!(is_whole, "--grid {text}: expected values separated by commas, found an empty one");
        let meanings = values.iter().map(|value| meaning(value)).collect::<Result<Vec<Value>>>()?;
        let equal = |(later, value): (usize, &Value)| {
            Some((meanings[..later].iter().position(|earlier| earlier == value)?, later))
        };
        if let Some((earlier, later)) = meanings.iter().enumerate().find_map(equal) {
            bail!("--grid {text}: expected different values, found {} and {}", values[earlier], values[later]);
        }
        Ok(Self { path, values })
    }

    pub(super) fn key(&self) -> String {
        self.path.join(".")
    }

    /// Returns the value at `index` as a number, if it is one.
    pub(super) fn number(&self, index: usize) -> Option<f64> {
        self.values.get(index)?.parse::<f64>().ok().filter(|number| number.is_finite())
    }
}

/// Parses a value as `--set` does; numbers are equal however they are written.
fn meaning(text: &str) -> Result<Value> {
    let (_, value) = config::parse_assignment(&format!("value={text}"))?;
    Ok(value.as_integer().map_or(value, |number| Value::Float(number as f64)))
}

/// Whether one of two keys is equal to the other or a parent of it.
fn overlap(a: &[String], b: &[String]) -> bool {
    a.starts_with(b) || b.starts_with(a)
}

/// Returns every combination of values, as an index for each grid; the last grid's values change fastest.
pub(super) fn choices(grids: &[Grid]) -> Result<Vec<Vec<usize>>> {
    let count = grids.iter().try_fold(1usize, |count, grid| count.checked_mul(grid.values.len()));
    let fits = count.is_some_and(|count| count <= MAX_SETTINGS);
    ensure!(fits, "--grid: expected at most {MAX_SETTINGS} settings");
    let longer = |choices: Vec<Vec<usize>>, grid: &Grid| {
        let with = |choice: Vec<usize>| (0..grid.values.len()).map(move |value| [&choice[..], &[value]].concat());
        choices.into_iter().flat_map(with).collect()
    };
    Ok(grids.iter().fold(vec![Vec::new()], longer))
}

/// Returns `key=value` of each grid, for the values that `choice` has the indices of.
pub(super) fn assignments(grids: &[Grid], choice: &[usize]) -> Vec<String> {
    grids.iter().zip(choice).map(|(grid, &index)| format!("{}={}", grid.key(), grid.values[index])).collect()
}

/// Returns the elements of a list, as written. Arrays, tables and quoted strings may hold commas of their own.
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
    values.extend(list.trim_end().ends_with(',').then(String::new));
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(grids: &[&str], set: &[&str]) -> Result<Vec<Grid>> {
        let [grids, set] = [grids, set].map(|texts| texts.iter().map(|&text| text.to_owned()).collect::<Vec<_>>());
        Grid::parse_all(&grids, &set)
    }

    #[test]
    fn values_are_kept_as_written() {
        for (text, values) in [
            ("loss.entropy.weight=0, 1e-4,1e-3", &["0", "1e-4", "1e-3"][..]),
            ("train.lr=1e-3,{ from = 1e-3, to = 1e-4 }", &["1e-3", "{ from = 1e-3, to = 1e-4 }"]),
            ("train.unseen=sphere,dataset", &["sphere", "dataset"]),
        ] {
            let grid = &parsed(&[text], &[]).unwrap()[0];
            assert!(grid.values == values && text.starts_with(&grid.key()), "{grid:?}");
        }
    }

    #[test]
    fn the_last_grid_changes_fastest() {
        let grids = parsed(&["a=1,2", "b=3,4,5"], &[]).unwrap();
        let all = choices(&grids).unwrap();
        assert_eq!((all.len(), &all[1][..], &all[3][..]), (6, &[0, 1][..], &[1, 0][..]));
        assert_eq!(assignments(&grids, &all[3]), ["a=2", "b=3"]);
        assert_eq!(choices(&[]).unwrap(), [Vec::<usize>::new()]);
    }
}
