use serde::{Deserialize, Serialize};

use crate::Moment;
use crate::parse::ScheduleForm;

/// A number as a function of the [`Moment`] of a run. The crate's documentation has its forms and their TOML.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ScheduleForm", into = "ScheduleForm")]
pub struct Schedule {
    /// The shape over time.
    pub curve: Curve,
    /// Training steps over which the value rises linearly from 0; 0 for none.
    pub warmup: usize,
}

/// The shape of a [`Schedule`].
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// One value throughout.
    Constant(f64),
    /// `from + (to − from)·s`, with `s` rising from 0 to 1 between the shares `start` and `end` of the run.
    Linear {
        /// Value until `start`.
        from: f64,
        /// Value from `end` on.
        to: f64,
        /// Share of the run, in [0, 1].
        start: f64,
        /// Share of the run, in [start, 1].
        end: f64,
    },
    /// `from·(to/from)^s`, with `s` as for [`Curve::Linear`].
    Exponential {
        /// Value until `start`, above 0.
        from: f64,
        /// Value from `end` on, above 0.
        to: f64,
        /// Share of the run, in [0, 1].
        start: f64,
        /// Share of the run, in [start, 1].
        end: f64,
    },
    /// `from·factor^(step/every)`, with the exponent rounded down if `stairs`.
    Decay {
        /// Value at the first step.
        from: f64,
        /// Factor, above 0.
        factor: f64,
        /// Training steps, at least 1.
        every: usize,
        /// Whether the value changes every `every` steps only, instead of smoothly.
        stairs: bool,
    },
    /// Piecewise constant: the value of the last `(share, value)` whose share of the run has been reached. Shares rise
    /// from 0.
    Steps(Vec<(f64, f64)>),
}

impl Schedule {
    /// Returns a schedule of one value throughout.
    pub const fn constant(value: f64) -> Self {
        Self { curve: Curve::Constant(value), warmup: 0 }
    }

    /// Returns the value at a moment of the run.
    pub fn at(&self, moment: Moment) -> f64 {
        self.curve.at(moment) * self.warm(moment.step)
    }

    /// Returns whether the value is 0 throughout the run.
    pub fn is_zero(&self) -> bool {
        self.largest() == 0.0 && self.least() == 0.0
    }

    /// Returns the largest value of a run of any length.
    pub fn largest(&self) -> f64 {
        let largest = self.curve.extremes().1;
        largest.max(largest * self.warm(0))
    }

    /// Returns the least value of a run of any length. A warm-up begins at a share of the curve.
    pub fn least(&self) -> f64 {
        let least = self.curve.extremes().0;
        least.min(least * self.warm(0))
    }

    fn warm(&self, step: usize) -> f64 {
        if step < self.warmup { (step + 1) as f64 / self.warmup as f64 } else { 1.0 }
    }
}

impl From<f64> for Schedule {
    fn from(value: f64) -> Self {
        Self::constant(value)
    }
}

impl Curve {
    fn at(&self, Moment { step, progress }: Moment) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Linear { from, to, start, end } => {
                let s = between(*start, *end, progress);
                // Exact at both ends.
                from * (1.0 - s) + to * s
            }
            Self::Exponential { from, to, start, end } => match between(*start, *end, progress) {
                1.0 => *to,
                s => from * (to / from).powf(s),
            },
            Self::Decay { from, factor, every, stairs } => {
                let periods = step as f64 / *every as f64;
                from * factor.powf(if *stairs { periods.floor() } else { periods })
            }
            Self::Steps(steps) => {
                let reached = steps.iter().take_while(|(share, _)| *share <= progress).last();
                reached.or(steps.first()).map_or(0.0, |(_, value)| *value)
            }
        }
    }

    /// Returns the least and the largest value.
    fn extremes(&self) -> (f64, f64) {
        match self {
            Self::Constant(value) => (*value, *value),
            Self::Linear { from, to, .. } | Self::Exponential { from, to, .. } => (from.min(*to), from.max(*to)),
            Self::Decay { from, factor, .. } => {
                let last = match *factor {
                    factor if factor < 1.0 || *from == 0.0 => 0.0,
                    1.0 => *from,
                    _ => from.signum() * f64::INFINITY,
                };
                (from.min(last), from.max(last))
            }
            Self::Steps(steps) => steps
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, largest), (_, v)| (least.min(*v), largest.max(*v))),
        }
    }
}

/// Returns the share of the way from `start` to `end` at `progress`, in [0, 1]; a step if the two are equal.
fn between(start: f64, end: f64, progress: f64) -> f64 {
    if progress >= end {
        1.0
    } else if progress <= start {
        0.0
    } else {
        (progress - start) / (end - start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(curve: Curve, progress: f64) -> f64 {
        curve.at(Moment { step: 0, progress })
    }

    #[test]
    fn linear_and_exponential_keep_their_ends() {
        let linear = Curve::Linear { from: 1.0, to: 3.0, start: 0.2, end: 0.6 };
        assert_eq!([0.0, 0.2, 0.6, 1.0].map(|p| at(linear.clone(), p)), [1.0, 1.0, 3.0, 3.0]);
        assert!((at(linear, 0.4) - 2.0).abs() < 1e-12);
        let falling = Curve::Exponential { from: 1.0, to: 0.01, start: 0.0, end: 1.0 };
        assert_eq!([0.0, 1.0].map(|p| at(falling.clone(), p)), [1.0, 0.01]);
        assert!((at(falling, 0.5) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_ramp_of_no_length_is_a_step() {
        let step = Curve::Linear { from: 0.0, to: 1.0, start: 0.5, end: 0.5 };
        assert_eq!([0.0, 0.499, 0.5, 1.0].map(|p| at(step.clone(), p)), [0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn decay_is_smooth_or_in_stairs() {
        let decay = |stairs, step| {
            Curve::Decay { from: 8.0, factor: 0.5, every: 10, stairs }.at(Moment { step, progress: 0.0 })
        };
        assert_eq!([0, 9, 10, 25].map(|step| decay(true, step)), [8.0, 8.0, 4.0, 2.0]);
        assert!((decay(false, 5) - 8.0 * 0.5f64.sqrt()).abs() < 1e-12);
        assert_eq!(Curve::Decay { from: 8.0, factor: 0.5, every: 10, stairs: false }.at(Moment::END), 0.0);
    }

    #[test]
    fn steps_hold_until_the_next() {
        let steps = Curve::Steps(vec![(0.0, 4.0), (0.1, 2.0), (0.4, 1.0)]);
        assert_eq!([0.0, 0.09, 0.1, 0.3, 0.4, 1.0].map(|p| at(steps.clone(), p)), [4.0, 4.0, 2.0, 2.0, 1.0, 1.0]);
    }

    #[test]
    fn warm_up_rises_by_step() {
        let schedule = Schedule { curve: Curve::Constant(2.0), warmup: 4 };
        assert_eq!([0, 1, 3, 4, 9].map(|step| schedule.at(Moment { step, progress: 0.0 })), [0.5, 1.0, 2.0, 2.0, 2.0]);
    }

    #[test]
    fn zero_and_extremes() {
        assert!(Schedule::constant(0.0).is_zero());
        let ramp = Schedule { curve: Curve::Linear { from: 0.0, to: 1.0, start: 0.0, end: 1.0 }, warmup: 0 };
        assert!(!ramp.is_zero());
        assert_eq!((ramp.least(), ramp.largest()), (0.0, 1.0));
        let steps = Schedule { curve: Curve::Steps(vec![(0.0, 3.0), (0.5, 1.0)]), warmup: 0 };
        assert_eq!((steps.least(), steps.largest()), (1.0, 3.0));
        let decay =
            |from, factor| Schedule { curve: Curve::Decay { from, factor, every: 10, stairs: false }, warmup: 0 };
        let extremes = |schedule: Schedule| (schedule.least(), schedule.largest());
        assert_eq!(extremes(decay(2.0, 0.5)), (0.0, 2.0));
        assert_eq!(extremes(decay(2.0, 1.0)), (2.0, 2.0));
        assert_eq!(extremes(decay(2.0, 2.0)), (2.0, f64::INFINITY));
        assert_eq!(extremes(decay(-2.0, 2.0)), (f64::NEG_INFINITY, -2.0));
        assert_eq!(extremes(Schedule { curve: Curve::Constant(64.0), warmup: 100 }), (0.64, 64.0));
        assert_eq!(extremes(Schedule { curve: Curve::Constant(-1.0), warmup: 4 }), (-1.0, -0.25));
    }
}
