//! Time of a training step by phase.

use anyhow::{Result, ensure};
use infonerf_experiment::RunPlan;
use infonerf_ops::Traffic;
use infonerf_report::TextTable;
use infonerf_train::Phase;
use serde::Serialize;
use serde_json::json;

use crate::context::Bench;
use crate::output::median;
use crate::trial::{step_seconds, with_settings};

const PROTOCOL: &str = "the first steps are a warm-up and not counted; the schedule is that of the whole run, of which these \
                        are the first steps; totals are medians and 90th percentiles; phases are means of as many further steps, \
                        in which the device is waited for after each phase";

#[derive(Serialize)]
struct RunTiming {
    run: String,
    first_step: usize,
    last_step: usize,
    median_ms: f64,
    p90_ms: f64,
    traffic: Traffic,
    phases: Vec<PhaseTiming>,
}

#[derive(Serialize)]
struct PhaseTiming {
    phase: &'static str,
    ms: f64,
    share: f64,
}

/// Measures milliseconds per step by phase, from an untrained field. `steps` are `[warm-up, measured]`.
pub fn run(bench: &Bench, steps: [u32; 2], print: &mut dyn FnMut(&str)) -> Result<()> {
    print(&bench.heading());
    let mut rows = Vec::new();
    for plan in &bench.plans {
        let row = measure(bench, plan, steps.map(|count| count as usize), print)?;
        print(&text(&row));
        rows.push(row);
    }
    bench.save_results(PROTOCOL, &rows, json!({}))
}

fn measure(
    bench: &Bench,
    plan: &RunPlan,
    [warmup, steps]: [usize; 2],
    print: &mut dyn FnMut(&str),
) -> Result<RunTiming> {
    let label = plan.label();
    let iterations = plan.config.train.iterations.max(warmup + 2 * steps);
    let plan = with_settings(plan, [format!("train.iterations={iterations}")])?;
    let mut trainer = bench.trainer(&plan)?;
    print(&format!("{label}: {warmup} steps of warm-up"));
    step_seconds(&mut trainer, warmup)?;
    let first_step = trainer.progress().step + 1;
    print(&format!("{label}: {steps} steps"));
    let before = Traffic::now();
    let mut seconds = step_seconds(&mut trainer, steps)?;
    let traffic = Traffic::now() - before;
    let last_step = trainer.progress().step;
    trainer.synchronize_phases();
    let before = trainer.profile().clone();
    print(&format!("{label}: {steps} steps by phase"));
    let synchronised = step_seconds(&mut trainer, steps)?;
    ensure!(!synchronised.is_empty(), "bench step: the run is over before there is a step to measure");
    let total: f64 = synchronised.iter().sum();
    let ms = |spent: f64| 1e3 * spent / synchronised.len() as f64;
    let timing = |phase, spent| PhaseTiming { phase, ms: ms(spent), share: spent / total };
    let spent = |phase: Phase| (trainer.profile().spent(phase) - before.spent(phase)).as_secs_f64();
    let mut phases: Vec<_> = Phase::ALL.into_iter().map(|(phase, name)| timing(name, spent(phase))).collect();
    phases.push(timing("other", total - Phase::ALL.into_iter().map(|(phase, _)| spent(phase)).sum::<f64>()));
    seconds.sort_by(f64::total_cmp);
    let p90 = seconds.get((seconds.len() * 9).div_ceil(10).saturating_sub(1)).copied().unwrap_or(0.0);
    let median_ms = 1e3 * median(&seconds);
    Ok(RunTiming { run: label, first_step, last_step, median_ms, p90_ms: 1e3 * p90, traffic, phases })
}

fn text(row: &RunTiming) -> String {
    let table = TextTable::new(
        &row.phases,
        &[
            ("phase", |phase| phase.phase.into()),
            ("ms per step", |phase| format!("{:.2}", phase.ms)),
            ("share", |phase| format!("{:.1} %", 100.0 * phase.share)),
        ],
    );
    let RunTiming { run, first_step, last_step, median_ms, p90_ms, traffic, .. } = row;
    format!(
        "\n{run}, steps {first_step} to {last_step}: median {median_ms:.2} ms, 90 % below {p90_ms:.2} ms\nper step: {}\n\n{}",
        traffic.per_step(last_step + 1 - first_step),
        table.to_text()
    )
}
