use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::{Moment, is_default};

/// Number that depends on the [`Moment`] of a run. The crate's documentation lists its forms and their TOML.
/// Serialization omits fields that have their default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self", untagged, deny_unknown_fields)]
pub enum Schedule {
    /// One value throughout.
    Constant(f64),
    /// Ramp between two values: `s` rises linearly from 0 to 1 between the shares `start` and `end` of the run.
    Ramp {
        /// Value until `start`.
        from: f64,
        /// Value from `end` on.
        to: f64,
        /// Share of the run at which the ramp starts, in [0, 1].
        #[serde(default, skip_serializing_if = "is_default")]
        start: f64,
        /// Share of the run at which the ramp ends, in [start, 1].
        #[serde(default = "whole", skip_serializing_if = "is_whole")]
        end: f64,
        /// Shape of the ramp.
        #[serde(default, skip_serializing_if = "is_default")]
        curve: RampShape,
        /// Training steps over which the value rises linearly from 0; 0 for none.
        #[serde(default, skip_serializing_if = "is_default")]
        warmup: usize,
    },
    /// `from·factor^(step/every)`, with the exponent rounded down if `stairs`.
    Decay {
        /// Value at the first step.
        from: f64,
        /// Factor on the value after `every` steps, above 0.
        factor: f64,
        /// Number of training steps after which the value is multiplied by `factor`, at least 1.
        every: usize,
        /// Whether the value changes every `every` steps only, instead of smoothly.
        #[serde(default, skip_serializing_if = "is_default")]
        stairs: bool,
        /// Training steps over which the value rises linearly from 0; 0 for none.
        #[serde(default, skip_serializing_if = "is_default")]
        warmup: usize,
    },
    /// Piecewise constant: the value of the last `(share, value)` whose share of the run has been reached.
    Steps {
        /// Pairs of a share of the run and a value. Shares start at 0 and rise.
        steps: Vec<(f64, f64)>,
        /// Training steps over which the value rises linearly from 0; 0 for none.
        #[serde(default, skip_serializing_if = "is_default")]
        warmup: usize,
    },
}

/// Shape of a [`Schedule::Ramp`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RampShape {
    /// `from + (to − from)·s`.
    #[default]
    Linear,
    /// `from·(to/from)^s`, both above 0.
    Exponential,
}

impl Serialize for Schedule {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Self::serialize(self, serializer)
    }
}

/// Forms of a schedule in a config.
const FORMS: &str = "a number, { from, to [, start, end, curve = \"linear\" or \"exponential\", warmup] }, \
                     { from, factor, every [, stairs, warmup] } or { steps = [[share, value], ...] [, warmup] }";

impl<'de> Deserialize<'de> for Schedule {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let found = toml::Value::deserialize(deserializer)?;
        let fault = |_| de::Error::custom(format!("expected {FORMS}, found {found}"));
        let schedule = Self::deserialize(found.clone()).map_err(fault)?;
        schedule.validate().map_err(de::Error::custom)?;
        Ok(schedule)
    }
}

fn whole() -> f64 {
    1.0
}

fn is_whole(share: &f64) -> bool {
    *share == 1.0
}

impl Schedule {
    /// Refuses values that are not finite, and shares, factors and periods out of range.
    fn validate(&self) -> Result<(), String> {
        let finite = |values: &[f64]| {
            let found = values.iter().find(|value| !value.is_finite());
            found.map_or(Ok(()), |value| Err(format!("expected finite numbers, found {value}")))
        };
        let unless = |good: bool, message: String| if good { Ok(()) } else { Err(message) };
        match self {
            Self::Constant(value) => finite(&[*value]),
            &Self::Ramp { from, to, start, end, curve, .. } => {
                finite(&[from, to, start, end])?;
                let shares = "expected shares of the run 0 <= start <= end <= 1, found";
                let rising = 0.0 <= start && start <= end && end <= 1.0;
                unless(rising, format!("{shares} start = {start}, end = {end}"))?;
                let expected = "expected from and to above 0, with a finite ratio, for an exponential curve, found";
                let has_ratio = from > 0.0 && to > 0.0 && (to / from).is_finite();
                unless(curve == RampShape::Linear || has_ratio, format!("{expected} {from} and {to}"))
            }
            &Self::Decay { from, factor, every, .. } => {
                finite(&[from, factor])?;
                let message = format!("expected factor above 0 and every of at least 1, found {factor} and {every}");
                unless(factor > 0.0 && every > 0, message)
            }
            Self::Steps { steps, .. } => {
                steps.iter().try_for_each(|(share, value)| finite(&[*share, *value]))?;
                let starts = steps.first().is_some_and(|(share, _)| *share == 0.0);
                let rising = steps.windows(2).all(|pair| pair[0].0 < pair[1].0);
                let within = steps.last().is_some_and(|(share, _)| *share <= 1.0);
                let shares: Vec<f64> = steps.iter().map(|(share, _)| *share).collect();
                let expected = "expected steps whose shares of the run begin with 0, rise, and do not exceed 1";
                unless(starts && rising && within, format!("{expected}, found {shares:?}"))
            }
        }
    }

    /// Returns the value at a moment of the run.
    pub fn at(&self, Moment { step, progress }: Moment) -> f64 {
        let value = match self {
            Self::Constant(value) => *value,
            Self::Ramp { from, to, start, end, curve, .. } => match (between(*start, *end, progress), curve) {
                // Both shapes give exactly `from` at s = 0 and `to` at s = 1.
                (s, RampShape::Linear) => from * (1.0 - s) + to * s,
                (1.0, RampShape::Exponential) => *to,
                (s, RampShape::Exponential) => from * (to / from).powf(s),
            },
            // A power that overflows would make 0 NaN.
            Self::Decay { from: 0.0, .. } => 0.0,
            Self::Decay { from, factor, every, stairs, .. } => {
                let periods = step as f64 / *every as f64;
                from * factor.powf(if *stairs { periods.floor() } else { periods })
            }
            Self::Steps { steps, .. } => {
                let reached = steps.iter().take_while(|(share, _)| *share <= progress).last();
                reached.or(steps.first()).map_or(0.0, |(_, value)| *value)
            }
        };
        value * self.warm(step)
    }

    /// Returns whether the value is 0 throughout the run.
    pub fn is_zero(&self) -> bool {
        self.largest() == 0.0 && self.least() == 0.0
    }

    /// Returns the max value over a run of any length.
    pub fn largest(&self) -> f64 {
        let largest = self.extremes().1;
        largest.max(largest * self.warm(0))
    }

    /// Returns the min value over a run of any length. A warm-up starts at 1/`warmup` of the curve's value.
    pub fn least(&self) -> f64 {
        let least = self.extremes().0;
        least.min(least * self.warm(0))
    }

    /// Returns the min and the max value without the warm-up.
    fn extremes(&self) -> (f64, f64) {
        match self {
            Self::Constant(value) => (*value, *value),
            Self::Ramp { from, to, .. } => (from.min(*to), from.max(*to)),
            Self::Decay { from, factor, .. } => {
                let last = match *factor {
                    factor if factor < 1.0 || *from == 0.0 => 0.0,
                    1.0 => *from,
                    _ => from.signum() * f64::INFINITY,
                };
                (from.min(last), from.max(last))
            }
            Self::Steps { steps, .. } => steps
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, largest), (_, v)| (least.min(*v), largest.max(*v))),
        }
    }

    /// Returns the warm-up's factor on the value at `step`: (step + 1)/warmup, at most 1.
    fn warm(&self, step: usize) -> f64 {
        let warmup = match *self {
            Self::Constant(_) => 0,
            Self::Ramp { warmup, .. } | Self::Decay { warmup, .. } | Self::Steps { warmup, .. } => warmup,
        };
        if step < warmup { (step + 1) as f64 / warmup as f64 } else { 1.0 }
    }
}

impl From<f64> for Schedule {
    fn from(value: f64) -> Self {
        Self::Constant(value)
    }
}

/// Returns (progress − start)/(end − start), clamped to [0, 1]; if `start` equals `end`, a step from 0 to 1.
fn between(start: f64, end: f64, progress: f64) -> f64 {
    if progress >= end { 1.0 } else { ((progress - start) / (end - start)).max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Schedule, String> {
        let table: toml::Table = format!("w = {text}").parse().unwrap();
        table["w"].clone().try_into().map_err(|error: toml::de::Error| error.message().to_owned())
    }

    /// Checks values at shares of the run, min and max; every form survives a round trip through TOML and JSON.
    #[test]
    fn values_over_the_run() {
        #[allow(clippy::type_complexity, reason = "a table")]
        let at_shares: [(&str, &[(f64, f64)], (f64, f64)); 10] = [
            ("3", &[(0.0, 3.0), (1.0, 3.0)], (3.0, 3.0)),
            ("0.0", &[(0.5, 0.0)], (0.0, 0.0)),
            (
                "{ from = 1.0, to = 3.0, start = 0.2, end = 0.6 }",
                &[(0.0, 1.0), (0.2, 1.0), (0.4, 2.0), (0.6, 3.0), (1.0, 3.0)],
                (1.0, 3.0),
            ),
            ("{ from = 1.0, to = 0.01, curve = \"exponential\" }", &[(0.0, 1.0), (0.5, 0.1), (1.0, 0.01)], (0.01, 1.0)),
            (
                "{ from = 0.0, to = 1.0, start = 0.5, end = 0.5 }",
                &[(0.0, 0.0), (0.499, 0.0), (0.5, 1.0), (1.0, 1.0)],
                (0.0, 1.0),
            ),
            (
                "{ steps = [[0.0, 4], [0.1, 2], [0.4, 1]] }",
                &[(0.0, 4.0), (0.09, 4.0), (0.1, 2.0), (0.3, 2.0), (0.4, 1.0), (1.0, 1.0)],
                (1.0, 4.0),
            ),
            ("{ from = 2.0, factor = 0.5, every = 10 }", &[(0.5, 2.0)], (0.0, 2.0)),
            ("{ from = 2.0, factor = 1.0, every = 10 }", &[], (2.0, 2.0)),
            ("{ from = -2.0, factor = 2.0, every = 10 }", &[], (f64::NEG_INFINITY, -2.0)),
            ("{ from = -1.0, to = -1.0, warmup = 4 }", &[(0.0, -0.25)], (-1.0, -0.25)),
        ];
        for (text, values, extremes) in at_shares {
            let schedule = parse(text).unwrap();
            for (progress, want) in values {
                let found = schedule.at(Moment { step: 0, progress: *progress });
                assert!((found - want).abs() < 1e-12, "{text} at {progress}: {found}");
            }
            assert_eq!((schedule.least(), schedule.largest()), extremes, "{text}");
            assert_eq!(schedule.is_zero(), text == "0.0");
            assert_eq!(toml::Value::try_from(&schedule).unwrap().try_into::<Schedule>().unwrap(), schedule, "{text}");
            let json = serde_json::to_string(&schedule).unwrap();
            assert_eq!(serde_json::from_str::<Schedule>(&json).unwrap(), schedule, "{json}");
        }
    }

    #[test]
    fn values_by_step() {
        let warm = "{ from = 2.0, to = 2.0, warmup = 4 }";
        for (text, values) in [
            ("{ from = 8.0, factor = 0.5, every = 10, stairs = true }", [(9, 8.0), (10, 4.0), (25, 2.0)]),
            ("{ from = 8.0, factor = 0.5, every = 10 }", [(0, 8.0), (5, 8.0 * 0.5f64.sqrt()), (usize::MAX, 0.0)]),
            ("{ from = 0.0, factor = 2.0, every = 10 }", [(0, 0.0), (10, 0.0), (usize::MAX, 0.0)]),
            (warm, [(0, 0.5), (2, 1.5), (9, 2.0)]),
        ] {
            for (step, want) in values {
                let found = parse(text).unwrap().at(Moment { step, progress: 0.0 });
                assert!((found - want).abs() < 1e-12, "{text} at {step}: {found}");
            }
        }
        assert_eq!(toml::Value::try_from(parse(warm).unwrap()).unwrap().as_table().unwrap().len(), 3, "no defaults");
    }

    #[test]
    fn faults_name_the_expected_forms() {
        for (text, part) in [
            ("\"much\"", "expected a number, { from, to [, start, end, curve = \"linear\" or \"exponential\", "),
            ("\"much\"", ", found \"much\""),
            ("nan", "finite"),
            ("{ from = 1.0 }", ", found { from = 1.0 }"),
            ("{ from = 1, to = \"x\" }", ", found { from = 1, to = \"x\" }"),
            ("{ from = 1.0, to = inf }", "finite"),
            ("{ from = 1.0, to = 2.0, factor = 3.0 }", ", found { factor = 3.0, from = 1.0, to = 2.0 }"),
            ("{ from = 1.0, to = 2.0, curve = \"cubic\" }", ", found { curve = \"cubic\", from = 1.0, to = 2.0 }"),
            ("{ from = 1.0, to = 2.0, start = 0.5, end = 0.2 }", "start <= end"),
            ("{ from = 0.0, to = 2.0, curve = \"exponential\" }", "above 0"),
            ("{ from = 2.0, to = 0.0, curve = \"exponential\" }", "above 0"),
            ("{ from = 1e-320, to = 2.0, curve = \"exponential\" }", "finite ratio"),
            ("{ from = 1.0, factor = 0.0, every = 1 }", "above 0"),
            ("{ from = 1.0, factor = 0.5, every = 0 }", "at least 1"),
            ("{ steps = [[0.1, 1]] }", "begin with 0, rise, and do not exceed 1, found [0.1]"),
            ("{ steps = [[0.0, 1], [0.0, 2]] }", "rise"),
            ("{ from = 1.0, to = 2.0, ends = 2.0 }", ", found { ends = 2.0, from = 1.0, to = 2.0 }"),
        ] {
            let message = parse(text).unwrap_err();
            assert!(message.contains(part), "{text}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
