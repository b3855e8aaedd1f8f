//! Descriptions of experiments before they run: for `infonerf list NAME` and `infonerf config NAME`.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use toml::{Table, Value};

use crate::file::{Layers, Start};
use crate::plan::{Experiment, Selection, assign};

/// Keys that mark a table of a config as a single value: a schedule, a choice of views or a mask.
const VALUE_TAGS: [&str; 4] = ["from", "steps", "kind", "rule"];

/// An experiment before it runs.
#[derive(Clone, Debug)]
pub struct Description {
    /// Title, data and runs.
    pub experiment: Experiment,
    /// Names of the experiments that this one is based on, the nearest first.
    pub bases: Vec<String>,
    /// Text of the experiment's file.
    pub text: String,
}

/// Describes the experiment called `name`: a built-in one, or the path of a file.
pub fn describe(name: &str) -> Result<Description> {
    let layers = Layers::read(name)?;
    let experiment = Experiment::plan(name, &Selection::default())?;
    let bases = layers.bases().map(str::to_owned).collect();
    Ok(Description { experiment, bases, text: layers.text })
}

/// A key of a config, its value, and what set it.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigKey {
    /// Dotted name of the key.
    pub key: String,
    /// Value as TOML.
    pub value: String,
    /// Source of the value: `preset fast`, `fast-losses.toml`, `variant nerf` or `--set`.
    pub origin: String,
}

/// Returns the config of the first selected run of the experiment called `name`, by key, without optional keys that have their
/// default, and what set each key last: the preset, a file, the variant or `selection`.
pub fn config_origins(name: &str, selection: &Selection) -> Result<Vec<ConfigKey>> {
    let plan = Experiment::plan(name, selection)?.runs.into_iter().next().context("expected at least one run")?;
    let layers = Layers::read(name)?;
    let variants = layers.variants()?;
    let chosen = variants.iter().find(|known| known.name == plan.variant).context("expected the variant")?;
    let mut origins = vec![(format!("preset {}", plan.preset.name()), plan.preset.table())];
    if chosen.start == Start::Experiment {
        origins.extend(layers.configs().map(|(file, config)| (file.to_owned(), config.clone())));
    }
    origins.push((format!("variant {}", plan.variant), chosen.changes.clone()));
    let mut set = Table::new();
    assign(&mut set, &selection.set)?;
    origins.push(("--set".to_owned(), set));
    // Through text, which writes the `f32` 0.001 as 0.001 and not as 0.0010000000474974513.
    let whole: Table = toml::to_string(&plan.config)?.parse()?;
    let described = |(key, value): (String, &Value)| {
        let origin = origins.iter().rev().find(|(_, table)| sets(table, &key)).map(|(origin, _)| origin.clone());
        ConfigKey { key, value: value.to_string(), origin: origin.unwrap_or_default() }
    };
    Ok(values(&whole, &|_, _| false).into_iter().map(described).collect())
}

/// Returns the dotted keys of the configs of the experiment called `name`, over all its variants, as `--set` takes them: a
/// value that is a table itself, such as a schedule, has one key.
pub fn config_keys(name: &str) -> Result<BTreeSet<String>> {
    let mut keys = BTreeSet::new();
    // The section `field` has a key `kind` as well, but is not a single value.
    let is_value = |key: &str, table: &Table| key != "field" && VALUE_TAGS.iter().any(|tag| table.contains_key(*tag));
    for plan in Experiment::plan(name, &Selection::default())?.runs {
        keys.extend(values(&Table::try_from(&plan.config)?, &is_value).into_iter().map(|(key, _)| key));
    }
    Ok(keys)
}

/// Returns every value in `table` with its dotted key; a nested table is a value if `is_value` holds for its last key and itself.
fn values<'a>(table: &'a Table, is_value: &dyn Fn(&str, &Table) -> bool) -> Vec<(String, &'a Value)> {
    let of_entry = |(key, value): (&'a String, &'a Value)| match value {
        Value::Table(table) if !is_value(key, table) => {
            values(table, is_value).into_iter().map(|(rest, value)| (format!("{key}.{rest}"), value)).collect()
        }
        value => vec![(key.clone(), value)],
    };
    table.iter().flat_map(of_entry).collect()
}

/// Whether `table` has a value at the dotted `key`, or a value that is not a table at a parent of `key`.
fn sets(table: &Table, key: &str) -> bool {
    let (first, rest) = key.split_once('.').unwrap_or((key, ""));
    match table.get(first) {
        Some(Value::Table(table)) => rest.is_empty() || sets(table, rest),
        value => value.is_some(),
    }
}
