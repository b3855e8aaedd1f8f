//! Choices of views, as configs write them.

use std::fmt::Display;
use std::str::FromStr;

use infonerf_scene::{TestProtocol, ViewSelection};
use serde::{Deserialize, Deserializer, Serializer, de};
use toml::Value;

/// Parses a choice of views from a string, a view's id or a list of ids.
fn parse<T: FromStr<Err = String>, E: de::Error>(value: &Value) -> Result<T, E> {
    let text = match value {
        Value::String(text) => text.clone(),
        Value::Array(ids) => ids.iter().map(Value::to_string).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    };
    T::from_str(&text).map_err(E::custom)
}

pub(super) fn test_views<'de, D: Deserializer<'de>>(deserializer: D) -> Result<TestProtocol, D::Error> {
    parse(&Value::deserialize(deserializer)?)
}

pub(super) fn as_text<S: Serializer>(value: &impl Display, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

pub(super) fn training_views<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ViewSelection, D::Error> {
    match Value::deserialize(deserializer)? {
        table @ Value::Table(_) => ViewSelection::deserialize(table).map_err(de::Error::custom),
        text if text.as_str().is_some_and(|text| text.contains('@')) => {
            Err(de::Error::custom(format!("expected views without a seed, which is the run's, found {text}")))
        }
        text => parse(&text),
    }
}

#[cfg(test)]
mod tests {
    use crate::config::{Config, Preset};

    #[test]
    fn views_are_read_from_text_and_lists() {
        let read = |assignment: &str| Config::of(Preset::Paper, [assignment]).map_err(|error| error.to_string());
        let views = |text: &str| read(&format!("scene.views={text}")).unwrap().scene.views;
        for (text, want) in [
            ("26,86,2,55", "26,86,2,55"),
            ("[26, 86, 2, 55]", "26,86,2,55"),
            ("{kind='ids',ids=[26,86,2,55]}", "26,86,2,55"),
            ("7", "7"),
            ("all", "all"),
            ("seed-3", "seed-3@0"),
            ("{kind='farthest',count=4}", "farthest-4@0"),
            ("narrow-4/30", "narrow-4/30@0"),
            ("{kind='published',name='regnerf-3'}", "regnerf-3"),
        ] {
            assert_eq!(views(text).to_string(), want);
        }
        for (text, want) in [("0,8", "0,8"), ("[0, 8]", "0,8"), ("3", "3"), ("first-2", "first-2")] {
            assert_eq!(read(&format!("eval.test={text}")).unwrap().eval.test.to_string(), want);
        }
        for (assignment, message) in [
            ("scene.views=4 views", "scene.views: expected `all`, view ids `26,86,2,55`, `seed-4`, "),
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
