use serde::{Deserialize, Serialize};

use crate::config::EarlyStoppingConfig;

/// Mean training error over windows of steps: see [`EarlyStoppingConfig`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EarlyStopping {
    /// Steps of the present window.
    pub steps: usize,
    /// Sum of their errors.
    pub sum: f64,
    /// Mean error of the window before.
    pub before: Option<f64>,
    /// Whether the error has plateaued.
    pub plateaued: bool,
}

impl EarlyStopping {
    /// Adds the error of a step, and returns whether the error has plateaued with this step.
    pub(crate) fn add(&mut self, config: &EarlyStoppingConfig, error: f64) -> bool {
        if config.patience == 0 {
            return false;
        }
        self.steps += 1;
        self.sum += error;
        if self.steps < config.patience {
            return false;
        }
        let mean = self.sum / self.steps as f64;
        let plateaued = self.before.is_some_and(|before| mean > (1.0 - config.min_delta) * before);
        *self = Self { steps: 0, sum: 0.0, before: Some(mean), plateaued };
        plateaued
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_when_the_error_plateaus() {
        let config = EarlyStoppingConfig { patience: 10, min_delta: 0.1 };
        let mut stopping = EarlyStopping::default();
        // Halved every ten steps until the thirtieth, then constant: the window from 40 on is the first without a gain.
        let error = |step: usize| 0.5f64.powi((step / 10).min(3) as i32);
        let end = (0..100).find(|&step| stopping.add(&config, error(step)));
        assert_eq!(end, Some(49));
        assert!(stopping.plateaued);
        let off = EarlyStoppingConfig { patience: 0, min_delta: 0.1 };
        assert!((0..100).all(|_| !EarlyStopping::default().add(&off, 1.0)));
    }
}
