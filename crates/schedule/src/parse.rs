//! [`Schedule`] in config files.

use std::fmt;

use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{Curve, Schedule};

const EXPECTED: &str = "a number, { from, to [, start, end, curve, warmup] }, { from, factor, every [, stairs, warmup] } \
                        or { steps = [[share, value], ...] [, warmup] }";

/// Every key of the table forms.
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    #[serde(skip_serializing_if = "Option::is_none")]
    from: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    to: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    start: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    end: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    curve: Option<Shape>,
    #[serde(skip_serializing_if = "Option::is_none")]
    factor: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    every: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stairs: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    steps: Option<Vec<(f64, f64)>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    warmup: Option<usize>,
}

#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Shape {
    Linear,
    Exponential,
}

impl Keys {
    fn schedule(self) -> Result<Schedule, String> {
        let warmup = self.warmup.unwrap_or(0);
        let finite = [self.from, self.to, self.start, self.end, self.factor].into_iter().flatten();
        if let Some(value) = finite.chain(self.steps.iter().flatten().flat_map(|s| [s.0, s.1])).find(|v| !v.is_finite())
        {
            return Err(format!("expected finite numbers, found {value}"));
        }
        let curve = match self {
            Self {
                from: Some(from),
                to: Some(to),
                start,
                end,
                curve,
                factor: None,
                every: None,
                stairs: None,
                steps: None,
                ..
            } => {
                let (start, end) = (start.unwrap_or(0.0), end.unwrap_or(1.0));
                if !(0.0 <= start && start <= end && end <= 1.0) {
                    return Err(format!(
                        "expected shares of the run 0 <= start <= end <= 1, found start = {start}, end = {end}"
                    ));
                }
                if curve == Some(Shape::Exponential) {
                    if from <= 0.0 || to <= 0.0 {
                        return Err(format!(
                            "expected from and to above 0 for an exponential curve, found {from} and {to}"
                        ));
                    }
                    Curve::Exponential { from, to, start, end }
                } else {
                    Curve::Linear { from, to, start, end }
                }
            }
            Self {
                from: Some(from),
                factor: Some(factor),
                every: Some(every),
                stairs,
                to: None,
                start: None,
                end: None,
                curve: None,
                steps: None,
                ..
            } => {
                if factor <= 0.0 || every == 0 {
                    return Err(format!("expected factor above 0 and every of at least 1, found {factor} and {every}"));
                }
                Curve::Decay { from, factor, every, stairs: stairs.unwrap_or(false) }
            }
            Self {
                steps: Some(steps),
                from: None,
                to: None,
                start: None,
                end: None,
                curve: None,
                factor: None,
                every: None,
                stairs: None,
                ..
            } => {
                let rising = steps.windows(2).all(|pair| pair[0].0 < pair[1].0);
                let within = steps.last().is_some_and(|(share, _)| *share <= 1.0);
                if steps.first().is_none_or(|(share, _)| *share != 0.0) || !rising || !within {
                    return Err("expected steps whose shares of the run begin with 0, rise, and do not exceed 1".into());
                }
                Curve::Steps(steps)
            }
            _ => return Err(format!("expected {EXPECTED}")),
        };
        Ok(Schedule { curve, warmup })
    }
}

impl From<&Schedule> for Keys {
    fn from(schedule: &Schedule) -> Self {
        let warmup = (schedule.warmup > 0).then_some(schedule.warmup);
        // Defaults are left out.
        let ramp = |from: f64, to: f64, start: f64, end: f64, curve| Self {
            from: Some(from),
            to: Some(to),
            start: (start != 0.0).then_some(start),
            end: (end != 1.0).then_some(end),
            curve,
            ..Self::default()
        };
        let keys = match &schedule.curve {
            Curve::Constant(value) => ramp(*value, *value, 0.0, 1.0, None),
            Curve::Linear { from, to, start, end } => ramp(*from, *to, *start, *end, None),
            Curve::Exponential { from, to, start, end } => ramp(*from, *to, *start, *end, Some(Shape::Exponential)),
            Curve::Decay { from, factor, every, stairs } => Self {
                from: Some(*from),
                factor: Some(*factor),
                every: Some(*every),
                stairs: stairs.then_some(true),
                ..Self::default()
            },
            Curve::Steps(steps) => Self { steps: Some(steps.clone()), ..Self::default() },
        };
        Self { warmup, ..keys }
    }
}

impl Serialize for Schedule {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match (&self.curve, self.warmup) {
            (Curve::Constant(value), 0) => serializer.serialize_f64(*value),
            _ => Keys::from(self).serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Schedule {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrTable;
        impl<'de> Visitor<'de> for NumberOrTable {
            type Value = Schedule;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(EXPECTED)
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<Schedule, E> {
                if value.is_finite() {
                    Ok(Schedule::constant(value))
                } else {
                    Err(E::custom(format!("expected a finite number, found {value}")))
                }
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<Schedule, E> {
                Ok(Schedule::constant(value as f64))
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<Schedule, E> {
                Ok(Schedule::constant(value as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Schedule, A::Error> {
                Keys::deserialize(MapAccessDeserializer::new(map))?.schedule().map_err(A::Error::custom)
            }
        }
        deserializer.deserialize_any(NumberOrTable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Schedule, String> {
        let table: toml::Table = format!("w = {text}").parse().unwrap();
        table["w"].clone().try_into().map_err(|error: toml::de::Error| error.message().to_owned())
    }

    #[test]
    fn every_form_survives_toml_and_json() {
        for text in [
            "0.001",
            "3",
            "{ from = 0.0, to = 0.001, start = 0.2, end = 0.4 }",
            "{ from = 0.002, to = 0.0006, curve = \"exponential\", warmup = 20 }",
            "{ from = 0.0005, factor = 0.1, every = 250_000 }",
            "{ from = 2e-5, factor = 0.5, every = 5000, stairs = true }",
            "{ steps = [[0.0, 4], [0.1, 2], [0.4, 1]] }",
            "{ from = 1.0, to = 1.0, warmup = 5 }",
        ] {
            let schedule = parse(text).unwrap();
            let toml = toml::Value::try_from(&schedule).unwrap();
            assert_eq!(toml.try_into::<Schedule>().unwrap(), schedule, "{text}");
            let json = serde_json::to_string(&schedule).unwrap();
            assert_eq!(serde_json::from_str::<Schedule>(&json).unwrap(), schedule, "{text}");
        }
    }

    #[test]
    fn faults_say_what_was_expected() {
        for (text, part) in [
            ("\"much\"", "expected a number"),
            ("nan", "finite"),
            ("{ from = 1.0 }", "expected a number, { from, to"),
            ("{ from = 1.0, to = inf }", "finite"),
            ("{ from = 1.0, to = 2.0, factor = 3.0 }", "expected a number, { from, to"),
            ("{ from = 1.0, to = 2.0, start = 0.5, end = 0.2 }", "start <= end"),
            ("{ from = 0.0, to = 2.0, curve = \"exponential\" }", "above 0"),
            ("{ from = 1.0, factor = 0.5, every = 0 }", "at least 1"),
            ("{ steps = [[0.1, 1]] }", "begin with 0"),
            ("{ steps = [[0.0, 1], [0.0, 2]] }", "rise"),
            ("{ start = 1.0, ends = 2.0 }", "unknown field"),
        ] {
            let message = parse(text).unwrap_err();
            assert!(message.contains(part), "{text}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
