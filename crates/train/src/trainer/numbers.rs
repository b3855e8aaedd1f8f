use std::collections::BTreeMap;

use burn::tensor::Tensor;
use infonerf_loss::{LossValues, Renders};
use infonerf_ops::to_host_together;

use crate::TrainError;

/// What a step came to: on the device until it is [read](Self::read).
pub(super) struct Numbers {
    /// Of the terms.
    names: Vec<&'static str>,
    /// The objective, the mean squared error, the mean opacity and each term, scalars.
    on_device: Vec<Tensor<1>>,
    /// The same on the host; nothing before they are read.
    values: Vec<f32>,
    /// Share of the seen pixels that show something other than the background.
    pub(super) foreground: f32,
}

impl Numbers {
    pub(super) fn of(losses: &LossValues, renders: &Renders) -> Self {
        let (output, target) = (renders.seen.output(), renders.seen.target.as_ref());
        let target = target.expect("training images show colours");
        let mse = renders.squared_error.clone().unwrap_or_else(|| renders.zero());
        let scalars = [losses.total.clone(), mse, output.acc.clone().mean()];
        let terms = losses.values.iter().map(|(_, value)| value.clone());
        let shown = target.rgba.iter().filter(|pixel| target.is_foreground(**pixel)).count();
        Self {
            names: losses.values.iter().map(|(name, _)| *name).collect(),
            on_device: scalars.into_iter().chain(terms).map(Tensor::inner).collect(),
            values: Vec::new(),
            foreground: shown as f32 / target.rgba.len() as f32,
        }
    }

    /// Reads the numbers of several steps in one transfer: a GPU has to be waited for each time. Tells whether any was not read yet.
    pub(super) fn read<'a>(steps: impl Iterator<Item = &'a mut Self>) -> bool {
        let mut steps: Vec<&mut Self> = steps.filter(|numbers| !numbers.is_read()).collect();
        if steps.is_empty() {
            return false;
        }
        let mut values = to_host_together(steps.iter_mut().flat_map(|numbers| numbers.on_device.drain(..))).into_iter();
        for numbers in steps {
            numbers.values = values.by_ref().take(3 + numbers.names.len()).collect();
        }
        true
    }

    pub(super) fn is_read(&self) -> bool {
        !self.values.is_empty()
    }

    /// # Errors
    /// If a term, or the objective, is not finite.
    pub(super) fn check(&self, step: usize) -> Result<(), TrainError> {
        match self.terms().chain([("total", self.total())]).find(|(_, value)| !value.is_finite()) {
            Some((term, value)) => Err(TrainError::NonFinite { what: format!("loss `{term}`"), value, step }),
            None => Ok(()),
        }
    }

    /// The objective.
    pub(super) fn total(&self) -> f32 {
        self.values[0]
    }

    /// Mean squared error of the seen rays' colours, over rays and channels.
    pub(super) fn mse(&self) -> f32 {
        self.values[1]
    }

    /// Mean opacity of the seen rays.
    pub(super) fn acc(&self) -> f32 {
        self.values[2]
    }

    pub(super) fn losses(&self) -> BTreeMap<String, f32> {
        self.terms().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    fn terms(&self) -> impl Iterator<Item = (&'static str, f32)> + '_ {
        self.names.iter().copied().zip(self.values[3..].iter().copied())
    }
}
