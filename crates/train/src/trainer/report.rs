//! Reading of losses, and what follows from them: events and collapses.

use std::collections::BTreeMap;
use std::time::Instant;

use burn::tensor::Tensor;
use infonerf_field::Field;
use infonerf_loss::{LossValues, Renders};
use infonerf_ops::{Traffic, to_host_together};
use infonerf_schedule::Moment;

use super::{Outcome, Trainer};
use crate::error::TrainError;
use crate::event::Event;

/// Losses of a step; on the device until they are [read](Self::read).
pub(super) struct StepLosses {
    /// Names of the terms.
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
    fn read<'a>(steps: impl Iterator<Item = &'a mut Self>) -> bool {
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

    /// # Errors
    /// If a term, or the objective, is not finite.
    fn check(&self, step: usize) -> Result<(), TrainError> {
        match self.terms().chain([("total", self.total())]).find(|(_, value)| !value.is_finite()) {
            Some((term, value)) => Err(TrainError::NonFinite { what: format!("loss `{term}`"), value, step }),
            None => Ok(()),
        }
    }

    fn total(&self) -> f32 {
        self.values[0]
    }

    fn mse(&self) -> f32 {
        self.values[1]
    }

    fn acc(&self) -> f32 {
        self.values[2]
    }

    fn terms(&self) -> impl Iterator<Item = (&'static str, f32)> + '_ {
        self.names.iter().copied().zip(self.values[3..].iter().copied())
    }
}

/// A step that was taken, and is not reported yet.
pub(super) struct PendingStep {
    pub(super) at: Moment,
    pub(super) losses: StepLosses,
    pub(super) lr: f64,
    pub(super) rays: usize,
    pub(super) evaluated: f64,
    /// 1 if the objective was finite in this step and those pending before, else 0 and the model stays. On the device.
    pub(super) finite: Tensor<1>,
    /// Seconds that the step took, and of training so far, once they are counted.
    pub(super) seconds: [f64; 2],
}

impl<F: Field> Trainer<F> {
    /// Counts the last step, if one was `taken`, as `seconds` of training, and reports what is known.
    pub(crate) fn count_step(
        &mut self,
        taken: bool,
        seconds: f64,
        report: &mut impl FnMut(Event),
    ) -> Result<Outcome, TrainError> {
        if let Some(last) = self.pending.last_mut().filter(|_| taken) {
            self.progress.seconds += seconds;
            last.seconds = [seconds, self.progress.seconds];
            if !last.losses.is_read() && !self.is_over() {
                return Ok(Outcome::Running);
            }
        }
        self.catch_up(report)
    }

    /// Reads the losses of all pending steps, if as many as [`Self::read_every`] are pending.
    pub(super) fn read_if_due(&mut self) {
        if self.pending.len() >= self.read_every {
            StepLosses::read(self.pending.iter_mut().map(|step| &mut step.losses));
        }
    }

    /// Waits for the device, and reports the steps that are not reported yet.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn catch_up(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let (before, start) = (Traffic::now(), Instant::now());
        let mut pending = std::mem::take(&mut self.pending);
        if StepLosses::read(pending.iter_mut().map(|step| &mut step.losses)) {
            // What a device had left to do is training, too.
            let waited = start.elapsed().as_secs_f64();
            self.progress.seconds += waited;
            pending.last_mut().expect("is read").seconds[0] += waited;
        }
        self.profile.count_since(before);
        let rays: usize = pending.iter().map(|step| step.rays).sum();
        let rays_per_second = rays as f64 / pending.iter().map(|step| step.seconds[0]).sum::<f64>();
        for PendingStep { at, losses, lr, evaluated, seconds, .. } in pending {
            if let Err(error) = losses.check(at.step) {
                self.progress.step = at.step;
                return Err(error);
            }
            report(Event::Step {
                step: at.step + 1,
                seconds: seconds[1],
                loss: losses.total(),
                psnr: -10.0 * losses.mse().max(1e-12).log10(),
                lr,
                rays_per_second,
                acc: losses.acc(),
                evaluated,
                losses: losses.terms().map(|(name, value)| (name.to_owned(), value)).collect::<BTreeMap<_, _>>(),
            });
            if self.watch(at, &losses, report)? {
                // What came after it is of a field that is given up.
                break;
            }
        }
        Ok(match () {
            () if self.has_collapsed() => Outcome::Collapsed,
            () if self.is_over() => Outcome::Finished,
            () => Outcome::Running,
        })
    }

    /// Returns whether the field went empty; it then starts over with other weights while that is allowed.
    fn watch(&mut self, at: Moment, losses: &StepLosses, report: &mut impl FnMut(Event)) -> Result<bool, TrainError> {
        let step = at.step + 1;
        let empty = self.progress.count_opacity(losses.acc(), losses.foreground);
        if empty {
            // With the weights of another run there are no other ones to start over with.
            let others = self.config.train.init.as_os_str().is_empty();
            let restarted = others && self.progress.restarts < self.config.train.restarts;
            report(Event::Collapse { step, restarted });
            if restarted {
                self.restart()?;
            }
        }
        Ok(empty)
    }
}
