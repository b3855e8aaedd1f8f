//! Seconds per frame, by image size.

use std::time::Instant;

use anyhow::{Context, Result};
use infonerf_render::render_image;
use infonerf_report::chart::{Frame, Series, power_law_chart};
use infonerf_scene::resized_dimensions;
use infonerf_train::Trainer;
use serde::Serialize;

use super::context::Bench;
use super::options::Options;
use super::output::{TextTable, median};
use super::roofline::{self, Part};
use super::trial::{train, with_settings};
use infonerf_experiment::RunPlan;

/// Steps of training before rendering.
const STEPS: u32 = 300;
/// Frames of each size; the median counts.
const FRAMES: usize = 3;

const PROTOCOL: &str = "a field after a short training (train.iterations) renders test cameras with skipping as configured; \
                        seconds are medians over three frames, the first of all frames not counted";

/// Frames of one size.
#[derive(Serialize)]
pub(super) struct Row {
    run: String,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) seconds_per_frame: f64,
    frames_per_second: f64,
    samples_total: u64,
    samples_evaluated: u64,
}

#[derive(Serialize)]
struct Results<'a> {
    train_iterations: u32,
    rows: &'a [Row],
    /// Of the last row.
    roofline: &'a [Part],
}

pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<()> {
    let steps = options.steps.unwrap_or(STEPS);
    let mut rows = Vec::new();
    let mut series = Vec::new();
    let mut roofline = Vec::new();
    for plan in &bench.plans {
        let trainer = trained(bench, plan, steps)?;
        let own = frames(&trainer, plan, &options.sizes)?;
        let points = own.iter().map(|row| (f64::from(row.width.max(row.height)), row.seconds_per_frame)).collect();
        series.push(Series { name: plan.label(), points });
        if let Some(Row { samples_evaluated, seconds_per_frame, .. }) = own.last() {
            roofline = roofline::of_frame(&trainer, &plan.config, *samples_evaluated as f64, 1e3 * seconds_per_frame);
        }
        rows.extend(own);
    }
    let mut table = TextTable::new(&["run", "size", "s/frame", "frames/s", "samples", "evaluated"]);
    for row in &rows {
        table.row(vec![
            row.run.clone(),
            format!("{}x{}", row.width, row.height),
            format!("{:.3}", row.seconds_per_frame),
            format!("{:.2}", row.frames_per_second),
            format!("{:.2} M", row.samples_total as f64 / 1e6),
            format!("{:.2} M", row.samples_evaluated as f64 / 1e6),
        ]);
    }
    say(&format!("\nafter {steps} steps\n\n{}{}", table.to_text(), roofline::text(&roofline)));
    let frame = Frame::new("Rendering", "longest side (pixels)", "seconds per frame");
    bench.save_chart("render", &power_law_chart(&frame, &series)?)?;
    bench.save_results(PROTOCOL, &Results { train_iterations: steps, rows: &rows, roofline: &roofline })
}

/// `plan` after `steps` steps, which are its whole schedule.
pub(super) fn trained(bench: &Bench, plan: &RunPlan, steps: u32) -> Result<Trainer> {
    let plan = with_settings(plan, &[format!("train.iterations={steps}")])?;
    let mut trainer = bench.trainer(&plan)?;
    train(&mut trainer).with_context(|| plan.label())?;
    Ok(trainer)
}

/// Renders the first test cameras at each of `sizes`.
pub(super) fn frames(trainer: &Trainer, plan: &RunPlan, sizes: &[u32]) -> Result<Vec<Row>> {
    let learned = [trainer.trained()];
    let views = &trainer.scene().test;
    let first = &views.first().with_context(|| format!("{}: no test views", plan.label()))?.camera;
    let mut rows = Vec::new();
    for &size in sizes {
        let (width, height) = resized_dimensions(first.width, first.height, size);
        let frame = |index: usize| {
            let camera = views[index % views.len()].camera.resized(width, height);
            let start = Instant::now();
            let image = render_image(trainer.renderer(), &learned, &camera);
            (start.elapsed().as_secs_f64(), image.counts)
        };
        if rows.is_empty() {
            frame(0);
        }
        let measured: Vec<_> = (0..FRAMES).map(frame).collect();
        let seconds_per_frame = median(&measured.iter().map(|(seconds, _)| *seconds).collect::<Vec<_>>());
        rows.push(Row {
            run: plan.label(),
            width,
            height,
            seconds_per_frame,
            frames_per_second: 1.0 / seconds_per_frame,
            samples_total: measured.iter().map(|(_, counts)| counts.total).sum::<u64>() / FRAMES as u64,
            samples_evaluated: measured.iter().map(|(_, counts)| counts.evaluated).sum::<u64>() / FRAMES as u64,
        });
    }
    Ok(rows)
}
