//! Where the time of a training step goes, and how far that is from what the machine can do.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use infonerf_ops::Traffic;
use infonerf_report::chart::{Bar, Frame, bar_chart};
use infonerf_train::{Checkpoint, Phase};
use serde::Serialize;

use super::context::Bench;
use super::options::Options;
use super::output::{TextTable, median};
use super::roofline::{self, Part};
use super::trial::{step_seconds, with_settings};
use infonerf_experiment::RunPlan;

const STEPS: u32 = 50;
const WARMUP: u32 = 50;

const PROTOCOL: &str = "the first steps are a warm-up and not counted; the schedule is that of the whole run, of which these \
                        are the first steps; totals are medians and 90th percentiles; phases are means of as many further steps, \
                        in which the device is waited for after each phase";

#[derive(Serialize)]
struct Row {
    run: String,
    first_step: usize,
    last_step: usize,
    median_ms: f64,
    p90_ms: f64,
    /// Of these steps together.
    traffic: Traffic,
    phases: Vec<PhaseRow>,
    roofline: Vec<Part>,
}

#[derive(Serialize)]
struct PhaseRow {
    phase: &'static str,
    ms: f64,
    share: f64,
}

#[derive(Serialize)]
struct Results<'a> {
    rows: &'a [Row],
}

pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<()> {
    let warmup = options.warmup.unwrap_or(WARMUP) as usize;
    let steps = options.steps.unwrap_or(STEPS) as usize;
    let mut rows = Vec::new();
    for plan in &bench.plans {
        let row = measure(bench, plan, options.from.as_deref(), warmup, steps)?;
        say(&text(&row));
        let bars = row.phases.iter().map(|phase| Bar { label: short(phase.phase), value: phase.ms, spread: None });
        let bars: Vec<Bar> = bars.collect();
        let title = format!("{}: {:.1} ms per step", row.run, row.median_ms);
        let svg = bar_chart(&Frame::new(&title, "", "ms per step"), &bars)?;
        bench.save_chart(&format!("step-{}-{}-seed{}", plan.scene, plan.variant, plan.seed), &svg)?;
        rows.push(row);
    }
    bench.save_results(PROTOCOL, &Results { rows: &rows })
}

fn measure(bench: &Bench, plan: &RunPlan, from: Option<&Path>, warmup: usize, steps: usize) -> Result<Row> {
    let checkpoint = from
        .map(|run| {
            let (checkpoint, _) = Checkpoint::load(run)?;
            checkpoint.with_context(|| format!("--from {}: expected a run's checkpoint", run.display()))
        })
        .transpose()?;
    // A run that is over has steps to take here all the same.
    let before = checkpoint.as_ref().map_or(0, |checkpoint| checkpoint.progress().step);
    let iterations = plan.config.train.iterations.max(before + warmup + 2 * steps);
    let plan = with_settings(plan, &[format!("train.iterations={iterations}")])?;
    let mut trainer = bench.trainer(&plan)?;
    if let Some(checkpoint) = &checkpoint {
        trainer.resume(checkpoint)?;
    }
    step_seconds(&mut trainer, warmup)?;
    let first_step = trainer.progress().step + 1;
    let before = trainer.profile().traffic();
    let mut seconds = step_seconds(&mut trainer, steps)?;
    let traffic = trainer.profile().traffic() - before;
    let last_step = trainer.progress().step;
    trainer.synchronize_phases();
    let (before, samples) = (trainer.profile().clone(), trainer.progress().samples_evaluated);
    let synchronised = step_seconds(&mut trainer, steps)?;
    let samples = (trainer.progress().samples_evaluated - samples) as f64 / synchronised.len().max(1) as f64;
    ensure!(!synchronised.is_empty(), "bench step: the run is over before there is a step to measure");
    let total: f64 = synchronised.iter().sum();
    let row = |phase: &'static str, spent: f64| PhaseRow {
        phase,
        ms: 1e3 * spent / synchronised.len() as f64,
        share: spent / total,
    };
    let spent = |phase: Phase| (trainer.profile().spent(phase) - before.spent(phase)).as_secs_f64();
    let mut phases: Vec<PhaseRow> = Phase::ALL.into_iter().map(|phase| row(phase.name(), spent(phase))).collect();
    phases.push(row("other", total - Phase::ALL.into_iter().map(spent).sum::<f64>()));
    let roofline =
        roofline::of_step(&trainer, &plan.config, samples, |phase| 1e3 * spent(phase) / synchronised.len() as f64);
    seconds.sort_by(f64::total_cmp);
    let p90 = seconds.get((seconds.len() * 9).div_ceil(10).saturating_sub(1)).copied().unwrap_or(0.0);
    let (run, median_ms) = (plan.label(), 1e3 * median(&seconds));
    Ok(Row { run, first_step, last_step, median_ms, p90_ms: 1e3 * p90, traffic, phases, roofline })
}

fn text(row: &Row) -> String {
    let mut table = TextTable::new(&["phase", "ms per step", "share"]);
    for phase in &row.phases {
        table.row(vec![phase.phase.into(), format!("{:.2}", phase.ms), format!("{:.1} %", 100.0 * phase.share)]);
    }
    format!(
        "\n{}, steps {} to {}: median {:.2} ms, 90 % below {:.2} ms\nper step: {}\n\n{}{}",
        row.run,
        row.first_step,
        row.last_step,
        row.median_ms,
        row.p90_ms,
        row.traffic.per_step(row.last_step + 1 - row.first_step),
        table.to_text(),
        roofline::text(&row.roofline)
    )
}

/// Short enough to stand below a bar.
fn short(phase: &str) -> String {
    phase.trim_end_matches(" rays").to_owned()
}
