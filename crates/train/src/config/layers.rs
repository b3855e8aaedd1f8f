//! Layers of configs: presets and changes to them, each a TOML table that says how it differs from the one below.

use infonerf_scene::Layout;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::error::TrainError;

/// A complete config to start from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Preset {
    /// A factored field: ten to thirty seconds per scene on two cores.
    Fast,
    /// The fast preset for captures: no uniform background, space without an end.
    Capture,
    /// The capture preset for nine images or more that do not face forward: finer, and with fewer priors.
    Dense,
    /// Settings that the paper's text gives, at full size.
    Paper,
    /// Settings of the authors' code, at full size.
    Released,
}

impl Preset {
    /// Every preset.
    pub const ALL: [Self; 5] = [Self::Fast, Self::Capture, Self::Dense, Self::Paper, Self::Released];

    /// Minimal number of training views that [`Self::Dense`] is for.
    pub const DENSE_VIEWS: usize = 9;

    /// Returns the preset for a number of training `views` of a scene that this one suits: from [`Self::DENSE_VIEWS`]
    /// on, `Dense` takes the place of `Capture` unless the cameras face forward.
    #[must_use]
    pub fn for_views(self, views: usize, layout: Layout) -> Self {
        let is_dense = views >= Self::DENSE_VIEWS && layout != Layout::Forward;
        if self == Self::Capture && is_dense { Self::Dense } else { self }
    }

    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Capture => "capture",
            Self::Dense => "dense",
            Self::Paper => "paper",
            Self::Released => "released",
        }
    }

    /// Returns the preset's table.
    pub fn table(self) -> Table {
        let (base, changes) = match self {
            Self::Paper => return parse(include_str!("../../presets/paper.toml")),
            Self::Released => (Self::Paper, include_str!("../../presets/released.toml")),
            Self::Fast => (Self::Paper, include_str!("../../presets/fast.toml")),
            Self::Capture => (Self::Fast, include_str!("../../presets/capture.toml")),
            Self::Dense => (Self::Capture, include_str!("../../presets/dense.toml")),
        };
        let mut table = base.table();
        merge(&mut table, parse(changes));
        table
    }
}

fn parse(text: &str) -> Table {
    text.parse().expect("a preset is valid TOML: every preset is parsed by a test")
}

/// Lays `over` onto `base`: tables are merged key by key, anything else replaces what was there.
///
/// A table that names another `kind` than the one below replaces it whole, as does a schedule: their keys differ in meaning.
pub fn merge(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) if same_kind(below, &above) && !is_schedule(&above) => {
                merge(below, above);
            }
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

fn same_kind(below: &Table, above: &Table) -> bool {
    above.get("kind").is_none_or(|kind| below.get("kind") == Some(kind))
}

/// Whether a table is a whole [`Schedule`](infonerf_schedule::Schedule), and not a change to one.
fn is_schedule(table: &Table) -> bool {
    table.contains_key("from") || table.contains_key("steps")
}

/// Applies `dotted.key=value` to `table`. The value is TOML; a bare word is a string.
///
/// # Errors
/// If there is no `=`, or a part of the key is empty or no table.
pub fn assign(mut table: &mut Table, assignment: &str) -> Result<(), TrainError> {
    let (path, value) = parse_assignment(assignment)?;
    let [above @ .., last] = path.as_slice() else { return Ok(()) };
    for key in above {
        let inner = table.entry(key.clone()).or_insert_with(|| Value::Table(Table::new())).as_table_mut();
        let fault = || TrainError::config(key, "expected a table here: this key holds a single value");
        table = inner.ok_or_else(fault)?;
    }
    let over = Table::from_iter([(last.clone(), value)]);
    // Naming another kind drops the keys of the old one.
    if last == "kind" && !same_kind(table, &over) {
        table.clear();
    }
    merge(table, over);
    Ok(())
}

/// Splits `dotted.key=value` into its key and value.
///
/// # Errors
/// If there is no `=` or a part of the key is empty.
pub fn parse_assignment(assignment: &str) -> Result<(Vec<String>, Value), TrainError> {
    let fault = || TrainError::config(assignment, "expected dotted.key=value, found no `=`");
    let (key, text) = assignment.split_once('=').ok_or_else(fault)?;
    let path: Vec<String> = key.trim().split('.').map(str::to_owned).collect();
    if path.iter().any(String::is_empty) {
        return Err(TrainError::config(key, "expected dotted.key=value, found an empty part in the key"));
    }
    let text = text.trim();
    let parsed = format!("value = {text}").parse::<Table>().ok().and_then(|mut table| table.remove("value"));
    Ok((path, parsed.unwrap_or_else(|| Value::String(text.to_owned()))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nine_views_that_do_not_face_forward_take_the_dense_preset() {
        let chosen = |preset: Preset| {
            let cases = [(8, Layout::Object), (9, Layout::Object), (9, Layout::Forward)];
            cases.map(|(views, layout)| preset.for_views(views, layout))
        };
        assert_eq!(chosen(Preset::Capture), [Preset::Capture, Preset::Dense, Preset::Capture]);
        assert_eq!(chosen(Preset::Fast), [Preset::Fast; 3]);
    }

    #[test]
    fn layers_merge() {
        let mut base = parse("a = 1\n[f]\nkind = 'x'\nwidth = 3\n[g]\nn = 1\nm = 2");
        merge(&mut base, parse("a = 2\n[f]\nkind = 'y'\n[g]\nn = 5"));
        assert_eq!(base, parse("a = 2\n[f]\nkind = 'y'\n[g]\nn = 5\nm = 2"));
        assign(&mut base, "g.m = 1e-3").unwrap();
        assign(&mut base, "g.name=word").unwrap();
        assert_eq!(base, parse("a = 2\n[f]\nkind = 'y'\n[g]\nn = 5\nm = 1e-3\nname = 'word'"));
    }

    #[test]
    fn a_schedule_replaces_another_and_its_parts_can_be_set() {
        let mut base = parse("lr = { from = 1.0, factor = 0.1, every = 10 }\nw = 3");
        merge(&mut base, parse("lr = { from = 2.0, to = 1.0 }\nw = { from = 0.0, to = 3.0 }"));
        assert_eq!(base, parse("lr = { from = 2.0, to = 1.0 }\nw = { from = 0.0, to = 3.0 }"));
        assign(&mut base, "lr.from = 5.0").unwrap();
        merge(&mut base, parse("w.to = 4.0"));
        assert_eq!(base, parse("lr = { from = 5.0, to = 1.0 }\nw = { from = 0.0, to = 4.0 }"));
        assign(&mut base, "w = 7").unwrap();
        assert_eq!(base["w"], Value::Integer(7));
    }
}
