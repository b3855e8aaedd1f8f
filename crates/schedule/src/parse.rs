//! [`Schedule`] in config files.

use serde::{Deserialize, Serialize};

use crate::curve::{Curve, Schedule};

/// Forms of a schedule in config files. Defaults are not written.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, { from, to [, start, end, curve, warmup] }, { from, factor, every [, stairs, warmup] } \
                 or { steps = [[share, value], ...] [, warmup] }"
)]
pub(crate) enum ScheduleForm {
    Number(f64),
    Ramp(Ramp),
    Decay(Decay),
    Steps(Steps),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ramp {
    from: f64,
    to: f64,
    #[serde(default, skip_serializing_if = "is_default")]
    start: f64,
    #[serde(default = "whole", skip_serializing_if = "is_whole")]
    end: f64,
    #[serde(default, skip_serializing_if = "is_default")]
    curve: RampShape,
    #[serde(default, skip_serializing_if = "is_default")]
    warmup: usize,
}

#[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RampShape {
    #[default]
    Linear,
    Exponential,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Decay {
    from: f64,
    factor: f64,
    every: usize,
    #[serde(default, skip_serializing_if = "is_default")]
    stairs: bool,
    #[serde(default, skip_serializing_if = "is_default")]
    warmup: usize,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Steps {
    steps: Vec<(f64, f64)>,
    #[serde(default, skip_serializing_if = "is_default")]
    warmup: usize,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn whole() -> f64 {
    1.0
}

fn is_whole(share: &f64) -> bool {
    *share == 1.0
}

/// Refuses numbers that are not finite.
fn finite(values: impl IntoIterator<Item = f64>) -> Result<(), String> {
    let found = values.into_iter().find(|value| !value.is_finite());
    found.map_or(Ok(()), |value| Err(format!("expected finite numbers, found {value}")))
}

impl TryFrom<ScheduleForm> for Schedule {
    type Error = String;

    fn try_from(form: ScheduleForm) -> Result<Self, String> {
        let (curve, warmup) = match form {
            ScheduleForm::Number(value) => {
                finite([value])?;
                (Curve::Constant(value), 0)
            }
            ScheduleForm::Ramp(Ramp { from, to, start, end, curve, warmup }) => {
                finite([from, to, start, end])?;
                if !(0.0 <= start && start <= end && end <= 1.0) {
                    return Err(format!(
                        "expected shares of the run 0 <= start <= end <= 1, found start = {start}, end = {end}"
                    ));
                }
                let curve = match curve {
                    RampShape::Linear => Curve::Linear { from, to, start, end },
                    RampShape::Exponential if from > 0.0 && to > 0.0 => Curve::Exponential { from, to, start, end },
                    RampShape::Exponential => {
                        return Err(format!(
                            "expected from and to above 0 for an exponential curve, found {from} and {to}"
                        ));
                    }
                };
                (curve, warmup)
            }
            ScheduleForm::Decay(Decay { from, factor, every, stairs, warmup }) => {
                finite([from, factor])?;
                if factor <= 0.0 || every == 0 {
                    return Err(format!("expected factor above 0 and every of at least 1, found {factor} and {every}"));
                }
                (Curve::Decay { from, factor, every, stairs }, warmup)
            }
            ScheduleForm::Steps(Steps { steps, warmup }) => {
                finite(steps.iter().flat_map(|step| [step.0, step.1]))?;
                let rising = steps.windows(2).all(|pair| pair[0].0 < pair[1].0);
                let within = steps.last().is_some_and(|(share, _)| *share <= 1.0);
                if steps.first().is_none_or(|(share, _)| *share != 0.0) || !rising || !within {
                    return Err("expected steps whose shares of the run begin with 0, rise, and do not exceed 1".into());
                }
                (Curve::Steps(steps), warmup)
            }
        };
        Ok(Self { curve, warmup })
    }
}

impl From<Schedule> for ScheduleForm {
    fn from(Schedule { curve, warmup }: Schedule) -> Self {
        let ramp = |from, to, start, end, curve| Self::Ramp(Ramp { from, to, start, end, curve, warmup });
        match curve {
            Curve::Constant(value) if warmup == 0 => Self::Number(value),
            Curve::Constant(value) => ramp(value, value, 0.0, 1.0, RampShape::Linear),
            Curve::Linear { from, to, start, end } => ramp(from, to, start, end, RampShape::Linear),
            Curve::Exponential { from, to, start, end } => ramp(from, to, start, end, RampShape::Exponential),
            Curve::Decay { from, factor, every, stairs } => Self::Decay(Decay { from, factor, every, stairs, warmup }),
            Curve::Steps(steps) => Self::Steps(Steps { steps, warmup }),
        }
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
    fn faults_name_the_expected_forms() {
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
            ("{ from = 1.0, to = 2.0, ends = 2.0 }", "expected a number, { from, to"),
        ] {
            let message = parse(text).unwrap_err();
            assert!(message.contains(part), "{text}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
