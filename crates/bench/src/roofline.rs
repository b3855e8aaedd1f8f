//! How far a step and a frame are from what the machine can do.

use burn::module::Module;
use infonerf_field::{FieldConfig, FieldSpec, RadianceField};
use infonerf_ops::Peak;
use infonerf_ops::factored::Layout;
use infonerf_ops::mlp::Precision;
use infonerf_train::{Config, Phase, Trainer};
use serde::Serialize;

use super::output::TextTable;

/// A part of a step or a frame, held against the peaks of a product of matrices and of a copy in the same run.
#[derive(Serialize)]
pub(super) struct Part {
    part: &'static str,
    /// Floating-point operations and bytes of the field alone: sampling, compositing and losses are in the time only.
    flops: f64,
    bytes: f64,
    ms: f64,
    share_of_flops: f64,
    share_of_bytes: f64,
    /// The peaks: operations per second of products of this precision, and bytes per second.
    precision: Precision,
    peak_flops: f64,
    peak_bytes: f64,
}

/// The parts of a step of `samples` samples whose phases took `ms`; none for fields whose operations are not counted.
pub(super) fn of_step(trainer: &Trainer, config: &Config, samples: f64, ms: impl Fn(Phase) -> f64) -> Vec<Part> {
    let Some(cost) = Cost::of(trainer, config) else { return Vec::new() };
    let peak = Peak::measured(precision(config));
    let rendering = ms(Phase::Seen) + ms(Phase::Unseen) + ms(Phase::Neighbours);
    let of_samples = |(flops, bytes): (f64, f64)| (samples * flops, samples * bytes);
    // Samples of negligible slopes are not counted one by one: the rate is that of a pass without leaving any out.
    let left_out = matches!(&config.field, FieldConfig::Factored(field) if field.negligible > 0.0);
    // Number, gradient and two moments are read, three of them written.
    let adam = (12.0 * cost.parameters, 28.0 * cost.parameters);
    vec![
        Part::new("rendering", of_samples(cost.forward), rendering, &peak),
        Part::new(
            if left_out { "backward of all" } else { "backward" },
            of_samples(cost.backward),
            ms(Phase::Backward),
            &peak,
        ),
        Part::new("optimiser", adam, ms(Phase::Optimizer), &peak),
    ]
}

/// The same of a frame of `samples` samples.
pub(super) fn of_frame(trainer: &Trainer, config: &Config, samples: f64, ms: f64) -> Vec<Part> {
    let part = |Cost { forward: (flops, bytes), .. }| {
        Part::new("frame", (samples * flops, samples * bytes), ms, &Peak::measured(precision(config)))
    };
    Cost::of(trainer, config).map(part).into_iter().collect()
}

/// Of the products of the field.
fn precision(config: &Config) -> Precision {
    match &config.field {
        FieldConfig::Nerf(field) => field.precision,
        FieldConfig::Mip(field) => field.precision,
        _ => Precision::F32,
    }
}

impl Part {
    fn new(part: &'static str, (flops, bytes): (f64, f64), ms: f64, peak: &Peak) -> Self {
        let share = |amount: f64, peak: f64| 1e3 * amount / (ms * peak);
        Self {
            part,
            flops,
            bytes,
            ms,
            share_of_flops: share(flops, peak.flops),
            share_of_bytes: share(bytes, peak.bytes),
            precision: peak.precision,
            peak_flops: peak.flops,
            peak_bytes: peak.bytes,
        }
    }
}

/// Operations and bytes of a sample, forward and backward, and the field's parameters.
struct Cost {
    forward: (f64, f64),
    backward: (f64, f64),
    parameters: f64,
}

impl Cost {
    /// Of the factored field and of the MLPs of NeRF and mip-NeRF.
    fn of(trainer: &Trainer, config: &Config) -> Option<Self> {
        match &trainer.model().fine {
            RadianceField::Factored(field) => Some(Self::of_tables(field.layout())),
            field @ (RadianceField::Nerf(_) | RadianceField::Mip(_)) => {
                let weights = field.num_params() as f64;
                // In bfloat16 activations stay in the cache.
                let kept = match precision(config) {
                    Precision::F32 | Precision::Tf32 => 4.0 * config.field.footprint().per_sample as f64,
                    Precision::Bf16 => 0.0,
                };
                let networks = if trainer.model().coarse.is_some() { 2.0 } else { 1.0 };
                Some(Self {
                    forward: (2.0 * weights, kept),
                    backward: (4.0 * weights, 2.0 * kept),
                    parameters: networks * weights,
                })
            }
            _ => None,
        }
    }

    fn of_tables(layout: &Layout) -> Self {
        let channels: usize = layout.levels.iter().map(|level| 3 * level.channels).sum();
        let weights: usize = layout.layers.iter().map(|layer| layer.inputs * layer.outputs).sum();
        let kept: usize = layout.layers.iter().map(|layer| layer.inputs).sum();
        let [channels, weights, kept] = [channels, weights, kept].map(|count| count as f64);
        // Of a channel, four texels of a plane and two of a line are mixed in 14 operations; their gradient takes 24 more, and
        // is added to all six.
        Self {
            forward: (2.0 * weights + 14.0 * channels, 4.0 * (6.0 * channels + kept)),
            backward: (4.0 * weights + 38.0 * channels, 4.0 * (20.0 * channels + kept)),
            parameters: (layout.table_len() + layout.weight_len()) as f64,
        }
    }
}

/// As a table.
pub(super) fn text(parts: &[Part]) -> String {
    let Some(Part { precision, peak_flops, peak_bytes, .. }) = parts.first() else { return String::new() };
    let precision = format!("{precision:?}").to_lowercase();
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
    let peaks = format!("{:.0} GFLOP/s in {precision}, {:.1} GB/s", 1e-9 * peak_flops, 1e-9 * peak_bytes);
    format!("\n{}peaks: {peaks}\n", table.to_text())
}
