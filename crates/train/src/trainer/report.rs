//! Reading of losses, and the events and collapses that follow from them.

use std::time::Instant;

use burn::tensor::Tensor;
use infonerf_field::Field;
use infonerf_loss::{LossValues, Renders};
use infonerf_ops::to_host_together;
use infonerf_schedule::Moment;

use super::{Outcome, Trainer};
use crate::error::TrainError;
use crate::event::Event;

/// Losses of a step; on the device until they are [read](Self::read).
pub(super) struct StepLosses {
    names: Vec<&'static str>,
    /// The objective, the mean squared error, the mean opacity and each term, scalars.
    on_device: Vec<Tensor<1>>,
    /// Values of `on_device` on the host; empty before they are read.
    values: Vec<f32>,
    /// Share of the seen pixels that show something other than the background.
    foreground: f32,
}

impl StepLosses {
    pub(super) fn new(losses: &LossValues, renders: &Renders) -> Self {
        let mse = renders.squared_error.clone().unwrap_or_else(|| renders.zero());
        let scalars = [losses.total.clone(), mse, renders.seen.fine.acc.clone().mean()];
        let terms = losses.values.iter().map(|(_, value)| value.clone());
        let pixels = renders.target.foreground();
        let count = pixels.len();
        Self {
            names: losses.values.iter().map(|(name, _)| *name).collect(),
            on_device: scalars.into_iter().chain(terms).map(Tensor::inner).collect(),
            values: Vec::new(),
            foreground: pixels.filter(|shown| *shown).count() as f32 / count as f32,
        }
    }

    /// Reads the losses of several steps in one transfer, and returns whether any was not read yet.
    pub(super) fn read<'a>(steps: impl Iterator<Item = &'a mut Self>) -> bool {
        let mut steps: Vec<&mut Self> = steps.filter(|losses| !losses.is_read()).collect();
        if steps.is_empty() {
            return false;
        }
        let mut values = to_host_together(steps.iter_mut().flat_map(|losses| losses.on_device.drain(..))).into_iter();
        for losses in steps {
            losses.values = values.by_ref().take(3 + losses.names.len()).collect();
        }
        true
    }

    fn is_read(&self) -> bool {
        !self.values.is_empty()
    }
}

/// A step that was taken, and is not reported yet.
pub(crate) struct PendingStep {
    pub(super) at: Moment,
    pub(super) losses: StepLosses,
    pub(super) lr: f64,
    pub(super) rays: usize,
    pub(super) evaluated: f64,
    /// Flag on the device: 1 if the objective was finite in this and all pending steps before, else 0 and the model stays.
    pub(super) finite: Tensor<1>,
    /// Seconds of this step, and of training so far; 0 before they are counted.
    pub(super) seconds: [f64; 2],
}

impl<F: Field> Trainer<F> {
    /// Counts `step`, if one was taken, as `seconds` of training, and reports what is known.
    pub(crate) fn count_step(
        &mut self,
        step: Option<PendingStep>,
        seconds: f64,
        report: &mut impl FnMut(Event),
    ) -> Result<Outcome, TrainError> {
        if let Some(step) = step {
            self.progress.seconds += seconds;
            let is_read = step.losses.is_read();
            self.pending.push(PendingStep { seconds: [seconds, self.progress.seconds], ..step });
            if !is_read && !self.is_over() {
                return Ok(Outcome::Running);
            }
        }
        self.catch_up(report)
    }

    /// Waits for the device, and reports the steps that are not reported yet.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn catch_up(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let start = Instant::now();
        let mut pending = std::mem::take(&mut self.pending);
        if StepLosses::read(pending.iter_mut().map(|step| &mut step.losses)) {
            // The time of the work that the device had left counts as training.
            let waited = start.elapsed().as_secs_f64();
            self.progress.seconds += waited;
            let last = pending.last_mut().expect("is read");
            last.seconds = [last.seconds[0] + waited, self.progress.seconds];
        }
        let rays: usize = pending.iter().map(|step| step.rays).sum();
        let rays_per_second = rays as f64 / pending.iter().map(|step| step.seconds[0]).sum::<f64>();
        for PendingStep { at, losses, lr, evaluated, seconds, .. } in pending {
            let (&[loss, mse, acc], terms) = losses.values.split_first_chunk().expect("losses are read");
            let terms = losses.names.iter().copied().zip(terms.iter().copied());
            let is_bad = |(_, value): &(&str, f32)| !value.is_finite();
            if let Some((term, value)) = terms.clone().chain([("total", loss)]).find(is_bad) {
                self.progress.step = at.step;
                return Err(TrainError::NonFinite { what: format!("loss `{term}`"), value, step: at.step });
            }
            let step = at.step + 1;
            let (seconds, psnr, foreground) = (seconds[1], -10.0 * mse.max(1e-12).log10(), losses.foreground);
            let losses = terms.map(|(name, value)| (name.to_owned(), value)).collect();
            report(Event::Step { step, seconds, loss, losses, psnr, lr, rays_per_second, acc, evaluated });
            if self.progress.count_opacity(acc, foreground) {
                // Steps after this one belong to the collapsed field. A run that starts from `train.init` has no other weights.
                let has_random_weights = self.config.train.init.as_os_str().is_empty();
                let restarted = has_random_weights && self.progress.restarts < self.config.train.restarts;
                report(Event::Collapse { step, restarted });
                if restarted {
                    self.restart()?;
                }
                break;
            }
        }
        let outcome = if self.is_over() { Outcome::Finished } else { Outcome::Running };
        Ok(if self.progress.has_collapsed() { Outcome::Collapsed } else { outcome })
    }
}
