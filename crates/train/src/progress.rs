use infonerf_render::Counts;
use infonerf_schedule::Moment;
use serde::{Deserialize, Serialize};

use crate::collapse::EmptySteps;
use crate::early_stopping::EarlyStopping;

/// Progress of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Steps taken since the last fresh start.
    pub step: usize,
    /// The moment of the last step, at which pictures are rendered.
    pub at: Moment,
    /// Seconds of training so far, over all sessions.
    pub seconds: f64,
    /// Points along rays before skipping.
    pub samples_total: u64,
    /// Points along rays that a field evaluated.
    pub samples_evaluated: u64,
    /// Fresh starts after a collapse.
    pub restarts: usize,
    /// Running mean of the number of evaluated samples along a seen ray.
    pub samples_per_ray: f64,
    /// Steps in a row in which the field was empty.
    pub empty_steps: EmptySteps,
    /// Draws of training pixels that were rejected because the pixel is well fitted.
    pub pixels_skipped: u64,
    /// State of early stopping.
    pub early_stopping: EarlyStopping,
}

impl Progress {
    /// Adds the samples of a step.
    pub(crate) fn count(&mut self, counts: Counts, samples_per_ray: f64) {
        self.samples_total += counts.total;
        self.samples_evaluated += counts.evaluated;
        let before = if self.samples_per_ray > 0.0 { self.samples_per_ray } else { samples_per_ray };
        self.samples_per_ray = (0.9 * before + 0.1 * samples_per_ray).max(1.0);
    }

    /// Returns the progress after a fresh start: nothing is known of the new field.
    pub(crate) fn restarted(&self) -> Self {
        Self {
            step: 0,
            at: Moment::START,
            restarts: self.restarts + 1,
            samples_per_ray: 0.0,
            empty_steps: EmptySteps::default(),
            early_stopping: EarlyStopping::default(),
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresh_start_forgets_the_field_and_keeps_the_time() {
        let mut progress = Progress { step: 7, seconds: 3.0, ..Progress::default() };
        progress.count(Counts { total: 100, evaluated: 40 }, 20.0);
        let restarted = progress.restarted();
        assert_eq!((restarted.step, restarted.samples_per_ray, restarted.restarts), (0, 0.0, 1));
        assert_eq!((restarted.seconds, restarted.samples_evaluated), (3.0, 40));
    }
}
