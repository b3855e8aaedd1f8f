//! How far the parts of a factored field's step are from what the machine can do.

use infonerf_field::RadianceField;
use infonerf_ops::Peak;
use infonerf_ops::factored::Layout;
use infonerf_train::{Phase, Trainer};
use serde::Serialize;

use super::output::TextTable;

/// A part of a step, held against the peaks of a product of matrices and of a copy in the same run.
#[derive(Serialize)]
pub(super) struct Part {
    part: &'static str,
    /// Floating-point operations and bytes of the field alone: sampling, compositing and losses are in the time only.
    flops: f64,
    bytes: f64,
    ms: f64,
    share_of_flops: f64,
    share_of_bytes: f64,
}

/// The parts of a step of `samples` samples whose phases took `ms`; none for other fields than the factored one.
pub(super) fn parts(trainer: &Trainer, samples: f64, ms: impl Fn(Phase) -> f64) -> Vec<Part> {
    let RadianceField::Factored(field) = &trainer.model().fine else { return Vec::new() };
    let peak = Peak::measured();
    let layout = field.layout();
    let parameters = (layout.table_len() + layout.weight_len()) as f64;
    let rendering = ms(Phase::Seen) + ms(Phase::Unseen) + ms(Phase::Neighbours);
    let [forward, backward] = of_sample(layout).map(|(flops, bytes)| (samples * flops, samples * bytes));
    // Number, gradient and two moments are read, three of them written.
    let adam = (12.0 * parameters, 28.0 * parameters);
    let parts = [
        ("rendering", forward, rendering),
        ("backward", backward, ms(Phase::Backward)),
        ("optimiser", adam, ms(Phase::Optimiser)),
    ];
    let part = |(part, (flops, bytes), ms): (&'static str, (f64, f64), f64)| {
        let share = |amount: f64, peak: f64| 1e3 * amount / (ms * peak);
        let (share_of_flops, share_of_bytes) = (share(flops, peak.flops), share(bytes, peak.bytes));
        Part { part, flops, bytes, ms, share_of_flops, share_of_bytes }
    };
    parts.into_iter().map(part).collect()
}

/// Operations and bytes of a sample, forward and backward.
fn of_sample(layout: &Layout) -> [(f64, f64); 2] {
    let channels: usize = layout.levels.iter().map(|level| 3 * level.channels).sum();
    let weights: usize = layout.layers.iter().map(|layer| layer.inputs * layer.outputs).sum();
    let kept: usize = layout.layers.iter().map(|layer| layer.inputs).sum();
    let [channels, weights, kept] = [channels, weights, kept].map(|count| count as f64);
    // Of a channel, four texels of a plane and two of a line are mixed in 14 operations; their gradient takes 24 more, and is
    // added to all six.
    let forward = (2.0 * weights + 14.0 * channels, 4.0 * (6.0 * channels + kept));
    let backward = (4.0 * weights + 38.0 * channels, 4.0 * (6.0 * channels + 12.0 * channels + 2.0 * channels + kept));
    [forward, backward]
}

/// As a table.
pub(super) fn text(parts: &[Part]) -> String {
    if parts.is_empty() {
        return String::new();
    }
    let mut table = TextTable::new(&["field", "MFLOP", "MB", "GFLOP/s", "of peak", "GB/s", "of peak"]);
    for part in parts {
        let rate = |amount: f64| format!("{:.1}", 1e-6 * amount / part.ms);
        let share = |share: f64| format!("{:.0} %", 100.0 * share);
        table.row(vec![
            part.part.into(),
            format!("{:.1}", 1e-6 * part.flops),
            format!("{:.1}", 1e-6 * part.bytes),
            rate(part.flops),
            share(part.share_of_flops),
            rate(part.bytes),
            share(part.share_of_bytes),
        ]);
    }
    format!("\n{}", table.to_text())
}
