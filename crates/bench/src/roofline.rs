//! Roofline of a step and a frame: rates over the peaks of the machine.

use burn::module::Module;
use infonerf_field::{FieldConfig, FieldSpec, RadianceField};
use infonerf_ops::Peak;
use infonerf_ops::factored::FactoredLayout;
use infonerf_ops::mlp::Precision;
use infonerf_report::TextTable;
use infonerf_train::{Config, Phase, Trainer};
use serde::Serialize;

/// Part of a step or a frame, with the peaks of a matrix product and of a copy in the same run.
#[derive(Serialize)]
pub(crate) struct RooflinePart {
    part: &'static str,
    /// Floating-point operations of the field alone: sampling, compositing and losses count in the time only.
    flops: f64,
    bytes: f64,
    ms: f64,
    share_of_flops: f64,
    share_of_bytes: f64,
    /// Precision of the field's products and of the peak.
    precision: Precision,
    peak_flops: f64,
    peak_bytes: f64,
}

/// Lists the parts of a step of `samples` samples whose phases took `ms`; empty for fields whose operations are not counted.
pub(crate) fn of_step(
    trainer: &Trainer,
    config: &Config,
    samples: f64,
    ms: impl Fn(Phase) -> f64,
) -> Vec<RooflinePart> {
    let Some(cost) = Cost::of(trainer, config) else { return Vec::new() };
    let peak = Peak::measured(precision(config));
    let rendering = ms(Phase::Seen) + ms(Phase::Unseen) + ms(Phase::Neighbours);
    let of_samples = |(flops, bytes): (f64, f64)| (samples * flops, samples * bytes);
    // Samples with negligible gradients are not counted one by one: the rate is that of a pass over all.
    let left_out = matches!(&config.field, FieldConfig::Factored(field) if field.negligible > 0.0);
    // Parameter, gradient and two moments are read, three of them written.
    let adam = (12.0 * cost.parameters, 28.0 * cost.parameters);
    vec![
        RooflinePart::new("rendering", of_samples(cost.forward), rendering, &peak),
        RooflinePart::new(
            if left_out { "backward of all" } else { "backward" },
            of_samples(cost.backward),
            ms(Phase::Backward),
            &peak,
        ),
        RooflinePart::new("optimiser", adam, ms(Phase::Optimizer), &peak),
    ]
}

/// Lists the one part of a frame of `samples` samples that took `ms`; empty for fields whose operations are not counted.
pub(crate) fn of_frame(trainer: &Trainer, config: &Config, samples: f64, ms: f64) -> Vec<RooflinePart> {
    let part = |Cost { forward: (flops, bytes), .. }| {
        RooflinePart::new("frame", (samples * flops, samples * bytes), ms, &Peak::measured(precision(config)))
    };
    Cost::of(trainer, config).map(part).into_iter().collect()
}

fn precision(config: &Config) -> Precision {
    match &config.field {
        FieldConfig::Nerf(field) => field.precision,
        FieldConfig::Mip(field) => field.precision,
        _ => Precision::F32,
    }
}

impl RooflinePart {
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

/// Operations and bytes per sample, forward and backward, and number of parameters.
struct Cost {
    forward: (f64, f64),
    backward: (f64, f64),
    parameters: f64,
}

impl Cost {
    /// Counts for the factored field and the MLPs of NeRF and mip-NeRF; `None` for others.
    fn of(trainer: &Trainer, config: &Config) -> Option<Self> {
        match &trainer.model().fine {
            RadianceField::Factored(field) => Some(Self::of_tables(field.layout())),
            field @ (RadianceField::Nerf(_) | RadianceField::Mip(_)) => {
                let weights = field.num_params() as f64;
                // In bfloat16 activations stay in the cache.
                let kept = match precision(config) {
                    Precision::F32 => 4.0 * config.field.footprint().per_sample as f64,
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

    fn of_tables(layout: &FactoredLayout) -> Self {
        let channels: usize = layout.levels.iter().map(|level| 3 * level.channels).sum();
        let weights: usize = layout.layers.iter().map(|layer| layer.inputs * layer.outputs).sum();
        let kept: usize = layout.layers.iter().map(|layer| layer.inputs).sum();
        let [channels, weights, kept] = [channels, weights, kept].map(|count| count as f64);
        // Each channel mixes four texels of a plane and two of a line in 14 operations; the gradient takes 24 more, and is
        // added to all six.
        Self {
            forward: (2.0 * weights + 14.0 * channels, 4.0 * (6.0 * channels + kept)),
            backward: (4.0 * weights + 38.0 * channels, 4.0 * (20.0 * channels + kept)),
            parameters: (layout.table_len() + layout.weight_len()) as f64,
        }
    }
}

pub(crate) fn text(parts: &[RooflinePart]) -> String {
    let Some(RooflinePart { precision, peak_flops, peak_bytes, .. }) = parts.first() else { return String::new() };
    let precision = format!("{precision:?}").to_lowercase();
    let table = TextTable::new(
        parts,
        &[
            ("field", |part| part.part.into()),
            ("MFLOP", |part| format!("{:.1}", 1e-6 * part.flops)),
            ("MB", |part| format!("{:.1}", 1e-6 * part.bytes)),
            ("GFLOP/s", |part| format!("{:.1}", 1e-6 * part.flops / part.ms)),
            ("of peak", |part| format!("{:.0} %", 100.0 * part.share_of_flops)),
            ("GB/s", |part| format!("{:.1}", 1e-6 * part.bytes / part.ms)),
            ("of peak", |part| format!("{:.0} %", 100.0 * part.share_of_bytes)),
        ],
    );
    let peaks = format!("{:.0} GFLOP/s in {precision}, {:.1} GB/s", 1e-9 * peak_flops, 1e-9 * peak_bytes);
    format!("\n{}peaks: {peaks}\n", table.to_text())
}
