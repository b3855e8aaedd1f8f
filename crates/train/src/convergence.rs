//! When more steps do not pay any more.

use serde::{Deserialize, Serialize};

use crate::config::ConvergedConfig;

/// Mean training error over windows of steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Convergence {
    /// Steps of the window at hand.
    pub steps: usize,
    /// Sum of their errors.
    pub sum: f64,
    /// Mean error of the window before.
    pub before: Option<f64>,
    /// Whether the end was reached.
    pub reached: bool,
}

impl Convergence {
    /// Takes in the error of a step, and says whether the run just converged.
    pub(crate) fn add(&mut self, config: &ConvergedConfig, error: f64) -> bool {
        if config.window == 0 {
            return false;
        }
        self.steps += 1;
        self.sum += error;
        if self.steps < config.window {
            return false;
        }
        let mean = self.sum / self.steps as f64;
        let reached = self.before.is_some_and(|before| mean > (1.0 - config.gain) * before);
        *self = Self { steps: 0, sum: 0.0, before: Some(mean), reached };
        reached
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_when_errors_stop_to_fall() {
        let config = ConvergedConfig { window: 10, gain: 0.1 };
        let mut convergence = Convergence::default();
        // Halved every ten steps until the thirtieth, then constant: the window from 40 on is the first that gains nothing.
        let error = |step: usize| 0.5f64.powi((step / 10).min(3) as i32);
        let end = (0..100).find(|&step| convergence.add(&config, error(step)));
        assert_eq!(end, Some(49));
        assert!(convergence.reached);
        assert!((0..100).all(|_| !Convergence::default().add(&ConvergedConfig { window: 0, gain: 0.1 }, 1.0)));
    }
}
