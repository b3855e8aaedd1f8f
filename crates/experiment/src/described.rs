//! Descriptions of experiments before they run: for `infonerf list NAME` and `infonerf config NAME`.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Context, Result};
use toml::{Table, Value};

use crate::file::{Layers, Start};
use crate::plan::assign;
use crate::{Experiment, RunPlan, Selection};

/// Keys of which a table in a config has one if it is a single value: a schedule, a choice of views or a mask.
const VALUE_TAGS: [&str; 4] = ["from", "steps", "kind", "rule"];

/// An experiment before it runs.
#[derive(Clone, Debug)]
pub struct Description {
    /// One line on what it shows.
    pub title: String,
    /// The experiments that it changes, the nearest first.
    pub bases: Vec<String>,
    /// Folder of its scenes; `None` for the built-in ones.
    pub data: Option<PathBuf>,
    /// Runs by scene, variant and seed.
    pub runs: Vec<RunPlan>,
    /// The text of its file.
    pub text: String,
}

/// Describes the experiment called `name`: a built-in one, or the path of a file.
///
/// # Errors
/// As [`Experiment::plan`].
pub fn describe(name: &str) -> Result<Description> {
    let layers = Layers::read(name)?;
    let Experiment { about, runs } = Experiment::plan(name, &Selection::default())?;
    let bases = layers.bases().map(str::to_owned).collect();
    Ok(Description { title: about.title, bases, data: about.data, runs, text: layers.text.clone() })
}

/// A key of a config, its value, and what set it.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigKey {
    /// Dotted.
    pub key: String,
    /// Value as TOML.
    pub value: String,
    /// `preset fast`, `fast-losses.toml`, `variant nerf` or `--set`.
    pub origin: String,
}

/// Returns the complete config of a variant of the experiment called `name`, by key, with what set each key last: the
/// preset, a file, the variant or `selection`. The preset is that of the first run, unless the selection has one.
///
/// # Errors
/// As [`Experiment::plan`].
pub fn config_origins(name: &str, variant: &str, selection: &Selection) -> Result<Vec<ConfigKey>> {
    let selection = Selection { variants: vec![variant.to_owned()], ..selection.clone() };
    let plan = Experiment::plan(name, &selection)?.runs.into_iter().next().context("expected at least one run")?;
    let layers = Layers::read(name)?;
    let variants = layers.variants()?;
    let chosen = variants.iter().find(|known| known.name == variant).context("expected the variant")?;
    let mut origins = vec![(format!("preset {}", plan.preset.name()), plan.preset.table())];
    if chosen.start == Start::Experiment {
        origins.extend(layers.configs().map(|(file, config)| (file.to_owned(), config.clone())));
    }
    origins.push((format!("variant {variant}"), chosen.changes.clone()));
    let mut set = Table::new();
    assign(&mut set, &selection.set)?;
    origins.push(("--set".to_owned(), set));
    // By way of text, in which 0.001 in single precision is 0.001.
    let whole: Table = toml::to_string(&plan.config)?.parse()?;
    let described = |(key, value): (String, String)| {
        let origin = origins.iter().rev().find(|(_, table)| sets(table, &key)).map(|(origin, _)| origin.clone());
        ConfigKey { key, value, origin: origin.unwrap_or_default() }
    };
    Ok(leaves(&whole).into_iter().map(described).collect())
}

/// Returns the dotted keys of the configs of the experiment called `name`, over all its variants, as `--set` takes them: a
/// value that is a table itself, such as a schedule, has one key.
///
/// # Errors
/// As [`Experiment::plan`].
pub fn config_keys(name: &str) -> Result<BTreeSet<String>> {
    let mut keys = BTreeSet::new();
    for plan in describe(name)?.runs {
        for (section, value) in Table::try_from(&plan.config)? {
            add_keys(&section, value, &mut keys);
        }
    }
    Ok(keys)
}

/// Adds the keys in `value`, which is a section of a config or a part of one, to `keys`.
fn add_keys(key: &str, value: Value, keys: &mut BTreeSet<String>) {
    let Value::Table(table) = value else {
        keys.insert(key.to_owned());
        return;
    };
    let is_whole = |table: &Table| VALUE_TAGS.iter().any(|tag| table.contains_key(*tag));
    for (part, value) in table {
        let key = format!("{key}.{part}");
        match value {
            Value::Table(table) if is_whole(&table) => {
                keys.insert(key);
            }
            value => add_keys(&key, value, keys),
        }
    }
}

/// Returns every value of `table` that is no table, as TOML, with its dotted key.
pub(crate) fn leaves(table: &Table) -> Vec<(String, String)> {
    let leaf = |(key, value): (&String, &Value)| match value {
        Value::Table(table) => {
            leaves(table).into_iter().map(|(rest, value)| (format!("{key}.{rest}"), value)).collect()
        }
        value => vec![(key.clone(), value.to_string())],
    };
    table.iter().flat_map(leaf).collect()
}

/// Whether `table` sets the value of a dotted key, or something that it is a part of.
fn sets(table: &Table, key: &str) -> bool {
    let (first, rest) = key.split_once('.').unwrap_or((key, ""));
    match table.get(first) {
        Some(Value::Table(table)) => rest.is_empty() || sets(table, rest),
        value => value.is_some(),
    }
}
