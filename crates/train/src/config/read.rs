//! Reads a config from its table, with errors that require no knowledge of the program's types.

use toml::{Table, Value};

use super::Config;
use crate::error::TrainError;

/// Hint for a field that lacks keys: mostly `field.kind` was changed alone.
const ANOTHER_KIND: &str = "; a field of another kind keeps no key of the former, so set all of its own: \
                            `infonerf config EXPERIMENT --variant V` prints those of a variant";

/// Reads a config. An error is one line: the key, what was expected and what was found.
pub(super) fn config(table: Table) -> Result<Config, TrainError> {
    parse(table.clone()).map_err(|(path, message)| {
        let key = within(&table, &path, &message).map_or(path.clone(), |key| format!("{path}.{key}"));
        let hint = if path == "field" && message.starts_with("missing field") { ANOTHER_KIND } else { "" };
        TrainError::config(key, plain_message(&message) + hint)
    })
}

fn parse(table: Table) -> Result<Config, (String, String)> {
    serde_path_to_error::deserialize(Value::Table(table)).map_err(|error| {
        let (path, message) = (error.path().to_string(), error.into_inner().to_string());
        (path, message.lines().next().unwrap_or_default().to_owned())
    })
}

/// Finds the key at fault in a table with a `kind` at `path`, for which Serde reports no key: without it the fault differs.
fn within(table: &Table, path: &str, message: &str) -> Option<String> {
    fn inner<'a>(table: &'a mut Table, path: &str) -> Option<&'a mut Table> {
        let inner = path.split('.').try_fold(table, |table, part| table.get_mut(part)?.as_table_mut())?;
        inner.contains_key("kind").then_some(inner)
    }
    let kind = inner(&mut table.clone(), path)?.clone();
    kind.keys().filter(|key| *key != "kind").find_map(|key| {
        let mut without = table.clone();
        inner(&mut without, path)?.remove(key);
        parse(without).err().is_none_or(|(_, other)| other != message).then(|| key.clone())
    })
}

/// Returns the first line of a message of Serde in the words of configs: `expected a number, found "fast"`.
pub fn plain_message(message: &str) -> String {
    let message = message.lines().next().unwrap_or_default();
    let unquoted = |text: &str| text.replace('`', "");
    if let Some(rest) = message.strip_prefix("unknown variant ")
        && let Some((found, known)) = rest.split_once(", expected ")
    {
        return format!("expected {}, found \"{}\"", unquoted(known), unquoted(found));
    }
    for prefix in ["invalid type: ", "invalid value: ", "invalid length "] {
        if let Some((found, expected)) = message.strip_prefix(prefix).and_then(|rest| rest.rsplit_once(", expected ")) {
            let found = if prefix == "invalid length " { format!("{found} values") } else { plain_found(found) };
            return format!("expected {}, found {found}", plain_expected(expected));
        }
    }
    if message.starts_with("wanted exactly 1 element") {
        return "expected a name in quotes, found a table".into();
    }
    message.replace("unknown field", "unknown key").replace("missing field", "missing key")
}

/// Describes what Serde found: `integer \`3\``, `string "x"`, `sequence`.
fn plain_found(found: &str) -> String {
    let (kind, value) = found.split_once(' ').unwrap_or((found, ""));
    match (kind, value) {
        ("integer" | "boolean" | "string", value) if !value.is_empty() => value.replace('`', ""),
        ("floating", value) => value.trim_start_matches("point ").replace('`', ""),
        ("map", _) => "a table".into(),
        ("sequence", _) => "a list".into(),
        ("unit", _) => "another kind of value".into(),
        _ => found.into(),
    }
}

/// Describes what Serde expected, given the name of a type of Rust, or of Serde.
fn plain_expected(expected: &str) -> String {
    match expected {
        "usize" | "u8" | "u16" | "u32" | "u64" => "a whole number of at least 0".into(),
        "isize" | "i8" | "i16" | "i32" | "i64" => "a whole number".into(),
        "f32" | "f64" => "a number".into(),
        "a boolean" => "true or false".into(),
        "string only" => "a name in quotes".into(),
        "path string" => "a path in quotes".into(),
        "a sequence" => "a list".into(),
        "fewer elements in array" => "fewer values".into(),
        array if array.starts_with("an array of") || array.starts_with("a tuple of") => {
            format!("a list of {} values", array.rsplit(' ').next().unwrap_or_default())
        }
        table if ["struct", "internally", "a map", "map"].iter().any(|s| table.starts_with(s)) => "a table".into(),
        other => other.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    #[test]
    fn messages_name_keys_and_not_types() {
        for (assignment, expected) in [
            ("train.rays=many", "train.rays: expected a whole number of at least 0, found \"many\""),
            ("train.rays=-3", "train.rays: expected a whole number of at least 0, found -3"),
            ("train.rays=1.5", "train.rays: expected a whole number of at least 0, found 1.5"),
            ("train.rays=[1]", "train.rays: expected a whole number of at least 0, found a list"),
            ("train.exposure_compensation=1", "train.exposure_compensation: expected true or false, found 1"),
            ("train.grid_lr_multiplier=fast", "train.grid_lr_multiplier: expected a number, found \"fast\""),
            ("scene.background=[1.0,1.0]", "scene.background: expected a list of 3 values, found 2 values"),
            ("scene.background=1", "scene.background: expected a list of 3 values, found 1"),
            ("scene=3", "scene: expected a table, found 3"),
            ("scene.size=big", "scene.size: expected a whole number of at least 0, found \"big\""),
            ("train.batch=some", "train.batch: expected one of pixels, image, held-out, found \"some\""),
            ("scene.masks=no", "scene.masks: expected leave-out or score, found \"no\""),
            ("field.width=wide", "field.width: expected a whole number of at least 0, found \"wide\""),
            ("field.kind=cube", "field.kind: expected one of nerf, mip, "),
            ("train.init=3", "train.init: expected a path in quotes, found 3"),
            ("train.rayz=3", "train.rayz: unknown key `rayz`, expected one of `iterations`, "),
            ("scene.views={kind='wide'}", "scene.views: missing key `count`"),
            ("scene.views.ids=[1]", "scene.views"),
            ("loss.entropy.weight={from=0.0}", "loss.entropy.weight"),
            ("train.lr={from=1e-3,to=1e-4,shape='cosine'}", "train.lr"),
            ("nonsense", "nonsense: expected dotted.key=value"),
            ("train.batch={a=1,b=2}", "train.batch: expected a name in quotes, found a table"),
            ("train.batch=3", "train.batch: expected a name in quotes, found another kind of value"),
            ("a..b=1", "a..b: expected dotted.key=value"),
            ("train.rays=0", "train.rays: "),
            ("loss.entropy.weight=nan", "loss.entropy.weight: "),
            ("field.width=7", "field.width: "),
            ("train.downscale=0.5", "train.downscale: "),
            ("train.unseen_rays=0", "train.unseen_rays: "),
            (
                "field={kind='mip',layers=2,width=8,skip=0,position_frequencies=4,direction_frequencies=2,detail=1.0}",
                "render.placement: ",
            ),
        ] {
            let message = Config::of(Preset::Paper, [assignment]).unwrap_err().to_string();
            assert!(message.starts_with(expected) && message.lines().count() == 1, "{assignment}: {message}");
        }
    }
}
