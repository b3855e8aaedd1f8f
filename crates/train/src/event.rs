use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Event of training; one line of `metrics.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
pub enum Event {
    /// An optimizer step.
    Step {
        /// Steps taken, counting this one.
        step: usize,
        /// Seconds of training so far.
        seconds: f64,
        /// Value of the objective.
        loss: f32,
        /// Each term that took part, by name, without its weight.
        losses: BTreeMap<String, f32>,
        /// PSNR of the step's rays, dB.
        psnr: f32,
        /// Learning rate.
        lr: f64,
        /// Rays of all kinds per second, in this step.
        rays_per_second: f64,
        /// Mean opacity of the step's seen rays.
        acc: f32,
        /// Share of candidate samples that a field evaluated, in this step.
        evaluated: f64,
    },
    /// The field has collapsed: its space is empty.
    Collapse {
        /// Step at which it happened.
        step: usize,
        /// Whether training starts over with other weights.
        restarted: bool,
    },
}
