//! Schedules: values that change over a training run; and [`Fault`], an error about one key of a config.
//!
//! A [`Schedule`] maps a [`Moment`] of a run to a number. One type serves loss weights, learning rates, image sizes,
//! numbers of samples and annealing, with one syntax in config files:
//!
//! | in TOML | value |
//! |---|---|
//! | `1e-3` | constant |
//! | `{ from = 0.0, to = 1e-3, start = 0.2, end = 0.4 }` | linear between two shares of the run |
//! | `{ from = 2e-3, to = 6e-4, curve = "exponential" }` | geometric over the whole run |
//! | `{ from = 5e-4, factor = 0.1, every = 250_000 }` | multiplied by `factor` over `every` steps, smoothly |
//! | `{ from = 2e-5, factor = 0.5, every = 5000, stairs = true }` | multiplied by `factor` after every `every` steps |
//! | `{ steps = [[0.0, 4], [0.1, 2], [0.4, 1]] }` | piecewise constant: from each share of the run on |
//!
//! Each table form also takes `warmup`: a number of training steps over which the value rises linearly from 0.
//!
//! ```
//! use infonerf_schedule::{Moment, Schedule};
//!
//! let config: toml::Table = "w = { from = 0.0, to = 1e-3, start = 0.2, end = 0.4 }".parse().unwrap();
//! let weight: Schedule = config["w"].clone().try_into().unwrap();
//! assert_eq!(weight.at(Moment { step: 10, progress: 0.1 }), 0.0);
//! assert!((weight.at(Moment { step: 30, progress: 0.3 }) - 5e-4).abs() < 1e-12);
//! assert_eq!(weight.at(Moment::END), 1e-3);
//! ```

mod curve;
mod fault;

use serde::{Deserialize, Serialize};

pub use curve::{RampShape, Schedule};
pub use fault::Fault;

/// Returns whether a key has its default value and is not written, so that config files of earlier versions stay identical.
pub fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A point in time of a training run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moment {
    /// Training steps taken.
    pub step: usize,
    /// Share of the run's steps that is done, in [0, 1]; under a time budget, share of its time.
    pub progress: f64,
}

impl Moment {
    /// The first step.
    pub const START: Self = Self { step: 0, progress: 0.0 };
    /// The end of training.
    pub const END: Self = Self { step: usize::MAX, progress: 1.0 };
}
