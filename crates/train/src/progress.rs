use infonerf_render::Counts;
use infonerf_schedule::Moment;
use serde::{Deserialize, Serialize};

/// A field is empty if the mean opacity of seen rays is below `EMPTY_OPACITY_SHARE` · foreground, and their share foreground
/// above `EMPTY_OPACITY_SHARE`.
const EMPTY_OPACITY_SHARE: f32 = 0.01;
/// Number of empty steps in a row after which the field has collapsed.
const COLLAPSE: usize = 50;

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
    pub empty_steps: usize,
}

impl Progress {
    pub(crate) fn count(&mut self, counts: Counts, samples_per_ray: f64) {
        self.samples_total += counts.total;
        self.samples_evaluated += counts.evaluated;
        let before = if self.samples_per_ray > 0.0 { self.samples_per_ray } else { samples_per_ray };
        self.samples_per_ray = (0.9 * before + 0.1 * samples_per_ray).max(1.0);
    }

    /// Counts a step whose seen rays have mean opacity `acc`, while a share `foreground` of their pixels differs from the
    /// background. Returns whether the field has collapsed.
    pub(crate) fn count_opacity(&mut self, acc: f32, foreground: f32) -> bool {
        let is_empty = acc < EMPTY_OPACITY_SHARE * foreground && foreground > EMPTY_OPACITY_SHARE;
        self.empty_steps = if is_empty { self.empty_steps + 1 } else { 0 };
        self.has_collapsed()
    }

    /// Returns whether the field has collapsed. A run with fresh starts left then starts over.
    pub fn has_collapsed(&self) -> bool {
        self.empty_steps >= COLLAPSE
    }

    /// Returns the progress after a fresh start: times and counts are kept, everything about the old field is dropped.
    pub(crate) fn restarted(&self) -> Self {
        let Self { seconds, samples_total, samples_evaluated, restarts, .. } = *self;
        Self { seconds, samples_total, samples_evaluated, restarts: restarts + 1, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresh_start_forgets_the_field_and_keeps_the_time() {
        let mut progress = Progress { step: 7, seconds: 3.0, ..Progress::default() };
        progress.count(Counts { total: 100, evaluated: 40 }, 20.0);
        progress.count(Counts { total: 10, evaluated: 2 }, 10.0);
        assert!((progress.samples_per_ray - 19.0).abs() < 1e-9, "{}", progress.samples_per_ray);
        let restarted = progress.restarted();
        assert_eq!((restarted.step, restarted.samples_per_ray, restarted.restarts), (0, 0.0, 1));
        assert_eq!((restarted.seconds, restarted.samples_total, restarted.samples_evaluated), (3.0, 110, 42));
    }

    #[test]
    fn fifty_empty_steps_are_a_collapse() {
        let mut progress = Progress::default();
        assert!((0..49).all(|_| !progress.count_opacity(0.004, 0.5)));
        assert!(!progress.count_opacity(0.006, 0.5), "one step with something begins anew");
        assert_eq!((0..100).find(|_| progress.count_opacity(0.004, 0.5)), Some(49));
        assert!((0..100).all(|_| !progress.count_opacity(0.0, 0.005)), "there is nothing to show");
    }
}
