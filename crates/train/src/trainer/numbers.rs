use std::collections::BTreeMap;

use infonerf_loss::{LossValues, Renders};
use infonerf_ops::to_host_together;

use crate::TrainError;

/// What a step came to, on the host.
pub(super) struct Numbers {
    pub(super) total: f32,
    pub(super) losses: BTreeMap<String, f32>,
    /// Mean squared error of the seen rays' colours, over rays and channels.
    pub(super) mse: f32,
    /// Mean opacity of the seen rays.
    pub(super) acc: f32,
    /// Share of the seen pixels that show something other than the background.
    pub(super) foreground: f32,
}

impl Numbers {
    /// Reads everything back in one transfer: a GPU has to be waited for each time.
    ///
    /// # Errors
    /// If a term is not finite.
    pub(super) fn read(losses: &LossValues, renders: &Renders, step: usize) -> Result<Self, TrainError> {
        let (output, target) = (renders.seen.output(), renders.seen.target.as_ref());
        let target = target.expect("training images show colours");
        let mse = renders.squared_error.clone().unwrap_or_else(|| renders.zero());
        let scalars = [losses.total.clone(), mse, output.acc.clone().mean()];
        let terms = losses.values.iter().map(|(_, value)| value.clone());
        let values = to_host_together(scalars.into_iter().chain(terms));
        let named = losses.values.iter().map(|(name, _)| *name).zip(values[3..].iter().copied());
        let named: Vec<(&str, f32)> = named.collect();
        if let Some((term, value)) = named.iter().chain([&("total", values[0])]).find(|(_, value)| !value.is_finite()) {
            return Err(TrainError::NonFinite { what: format!("loss `{term}`"), value: *value, step });
        }
        let shown = target.rgba.iter().filter(|pixel| target.is_foreground(**pixel)).count();
        Ok(Self {
            total: values[0],
            losses: named.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
            mse: values[1],
            acc: values[2],
            foreground: shown as f32 / target.rgba.len() as f32,
        })
    }
}
