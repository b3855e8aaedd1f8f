//! Seconds per frame, by image size.

use std::time::Instant;

use anyhow::{Context, Result};
use infonerf_experiment::{RunPlan, Watch};
use infonerf_render::render_image;
use infonerf_report::TextTable;
use infonerf_scene::resized_dimensions;
use infonerf_train::Trainer;
use serde::Serialize;
use serde_json::json;

use crate::context::Bench;
use crate::output::median;
use crate::trial::{train, with_settings};

const FRAMES: usize = 3;

const PROTOCOL: &str = "a field after a short training (train.iterations) renders test cameras with skipping as configured; \
                        seconds are medians over three frames, the first of all frames not counted";

#[derive(Serialize)]
struct FrameTiming {
    run: String,
    width: u32,
    height: u32,
    seconds_per_frame: f64,
    frames_per_second: f64,
    samples_total: u64,
    samples_evaluated: u64,
}

/// Measures seconds per frame after `steps` of training, for each of `sizes`, the longest side in pixels.
pub fn run(bench: &Bench, steps: u32, sizes: &[u32], print: &mut dyn FnMut(&str), watch: &mut Watch<'_>) -> Result<()> {
    print(&bench.heading());
    let mut rows = Vec::new();
    for plan in &bench.plans {
        let plan = with_settings(plan, [format!("train.iterations={steps}")])?;
        let mut trainer = bench.trainer(&plan)?;
        train(&mut trainer, watch).with_context(|| plan.label())?;
        rows.extend(frames(&trainer, &plan, sizes, print)?);
    }
    let table = TextTable::new(
        &rows,
        &[
            ("run", |row: &FrameTiming| row.run.clone()),
            ("size", |row| format!("{}x{}", row.width, row.height)),
            ("s/frame", |row| format!("{:.3}", row.seconds_per_frame)),
            ("frames/s", |row| format!("{:.2}", row.frames_per_second)),
            ("samples", |row| format!("{:.2} M", row.samples_total as f64 / 1e6)),
            ("evaluated", |row| format!("{:.2} M", row.samples_evaluated as f64 / 1e6)),
        ],
    );
    print(&format!("\nafter {steps} steps\n\n{}", table.to_text()));
    bench.save_csv(&table)?;
    bench.save_results(PROTOCOL, &rows, json!({ "train_iterations": steps }))
}

fn frames(trainer: &Trainer, plan: &RunPlan, sizes: &[u32], print: &mut dyn FnMut(&str)) -> Result<Vec<FrameTiming>> {
    let learned = [trainer.trained()];
    let views = &trainer.scene().test;
    let first = &views.first().with_context(|| format!("{}: no test views", plan.label()))?.camera;
    let mut rows = Vec::new();
    for &size in sizes {
        let (width, height) = resized_dimensions(first.width, first.height, size);
        print(&format!("{}: rendering {width}x{height}", plan.label()));
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
        rows.push(FrameTiming {
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
