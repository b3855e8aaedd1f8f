//! Quality against training time: every variant with every budget, each an independent run, next to published systems.

use std::time::Duration;

use anyhow::Result;
use infonerf_experiment::RunPlan;
use infonerf_metrics::{LPIPS_ALEX, LPIPS_VGG, METRICS, Metric, PSNR, SSIM, Values};
use infonerf_report::chart::{Axis, ChartFrame, Series, marked_chart, pareto_frontier};
use serde::Serialize;
use serde_json::json;

use crate::context::{Bench, distinct};
use crate::output::TextTable;
use crate::published::PublishedFigures;
use crate::trial::{Trial, mean, mean_metrics, metric_of};

/// PSNR in dB; InfoNeRF's on lego in the paper is 18.92.
const TARGET: f64 = 18.9;

/// Metrics with a chart of their own.
const CHARTS: [Metric; 4] = [PSNR, SSIM, LPIPS_ALEX, LPIPS_VGG];

const PROTOCOL: &str = "each row is an independent run whose schedule follows the clock; train_seconds is training alone, \
                        without loading and evaluation; points are means over scenes and seeds";

#[derive(Serialize)]
struct BudgetTrial {
    budget_seconds: f64,
    #[serde(flatten)]
    trial: Trial,
}

/// Mean over scenes and seeds.
#[derive(Serialize)]
struct ParetoPoint {
    variant: String,
    budget_seconds: f64,
    train_seconds: f64,
    iterations: f64,
    on_frontier: bool,
    #[serde(flatten)]
    metrics: Values,
}

impl ParetoPoint {
    fn psnr(&self) -> f64 {
        metric_of(&self.metrics, "psnr").unwrap_or(f64::NAN)
    }
}

/// First time at which a variant reaches [`TARGET`].
#[derive(Serialize)]
struct TargetReached {
    variant: String,
    psnr: f64,
    /// Mean training time of the smallest budget that reaches it; `None` if none does.
    train_seconds: Option<f64>,
}

pub(crate) fn run(bench: &Bench, budgets: &[Duration], print: &mut dyn FnMut(&str)) -> Result<()> {
    print("");
    let mut rows: Vec<BudgetTrial> = Vec::new();
    for plan in &bench.plans {
        for budget in budgets {
            let budget = budget.as_secs_f64();
            let trial = bench.trial(&RunPlan { budget: Some(budget), ..plan.clone() })?;
            let (label, psnr, steps) = (plan.label(), trial.psnr(), trial.iterations);
            print(&format!("{label} in {budget} s: {psnr:.2} dB after {steps} steps"));
            rows.push(BudgetTrial { budget_seconds: budget, trial });
            save(bench, &rows)?;
        }
    }
    let points = points(&rows);
    print(&text(&points, &targets(&points)));
    let (scenes, views) = scenes_and_views(bench, &rows);
    PublishedFigures::read()?.lines(&scenes, &views).iter().for_each(|line| print(line));
    Ok(())
}

/// Lists scenes and numbers of training views that published figures must match; procedural scenes have no name there.
fn scenes_and_views(bench: &Bench, rows: &[BudgetTrial]) -> (Vec<String>, Vec<usize>) {
    let published = bench.plans.iter().all(|plan| plan.data.is_some());
    let scene = |row: &BudgetTrial| if published { row.trial.scene.clone() } else { String::new() };
    (distinct(rows, scene), distinct(rows, |row| row.trial.train_views))
}

fn points(rows: &[BudgetTrial]) -> Vec<ParetoPoint> {
    let keys = distinct(rows, |row| (row.trial.variant.clone(), row.budget_seconds));
    let point = |(variant, budget_seconds): (String, f64)| {
        let same = |row: &&BudgetTrial| row.trial.variant == variant && row.budget_seconds == budget_seconds;
        let trials: Vec<&Trial> = rows.iter().filter(same).map(|row| &row.trial).collect();
        let required = |value: fn(&Trial) -> f64| mean(&trials, |trial| Some(value(trial))).unwrap_or(f64::NAN);
        ParetoPoint {
            budget_seconds,
            train_seconds: required(|trial| trial.train_seconds),
            iterations: required(|trial| trial.iterations as f64),
            metrics: mean_metrics(&trials),
            on_frontier: false,
            variant,
        }
    };
    let mut points: Vec<ParetoPoint> = keys.into_iter().map(point).collect();
    let all: Vec<(f64, f64)> = points.iter().map(|point| (point.train_seconds, point.psnr())).collect();
    let frontier = pareto_frontier(&all);
    for (point, place) in points.iter_mut().zip(all) {
        point.on_frontier = frontier.contains(&place);
    }
    points
}

fn targets(points: &[ParetoPoint]) -> Vec<TargetReached> {
    let first = |variant: String| {
        let reached = points.iter().filter(|point| point.variant == variant && point.psnr() >= TARGET);
        let train_seconds = reached.map(|point| point.train_seconds).min_by(f64::total_cmp);
        TargetReached { variant, psnr: TARGET, train_seconds }
    };
    distinct(points, |point| point.variant.clone()).into_iter().map(first).collect()
}

/// Writes all results so far, which stay if the rest is interrupted.
fn save(bench: &Bench, rows: &[BudgetTrial]) -> Result<()> {
    let points = points(rows);
    bench.save_results(PROTOCOL, rows, json!({ "points": points, "passed": targets(&points) }))?;
    bench.save_csv(&csv(rows))?;
    let (published, (scenes, views)) = (PublishedFigures::read()?, scenes_and_views(bench, rows));
    let all = distinct(rows, |row| row.trial.scene.clone()).join(", ");
    for metric in CHARTS.iter().filter(|metric| is_measured(&points, metric)) {
        let key = metric.key();
        let cores = bench.conditions.cores;
        let frame = ChartFrame {
            title: format!("{} over training time, {all}, {cores} CPU cores", metric.descriptor.name),
            x: Axis::log("training (s)"),
            y: Axis::linear(metric.descriptor.heading().trim_end_matches([' ', '↑', '↓'])),
        };
        let series = |name: String| {
            let own = points.iter().filter(|point| point.variant == name);
            let points = own.filter_map(|point| Some((point.train_seconds, metric_of(&point.metrics, key)?))).collect();
            Series { name, points }
        };
        let series: Vec<Series> = distinct(&points, |point| point.variant.clone()).into_iter().map(series).collect();
        let marks = published.marks(&scenes, &views, key);
        bench.save_drawing(&format!("pareto-{key}"), &marked_chart(&frame, &series, &marks)?)?;
    }
    Ok(())
}

fn is_measured(points: &[ParetoPoint], metric: &Metric) -> bool {
    points.iter().any(|point| metric_of(&point.metrics, metric.key()).is_some())
}

fn csv(rows: &[BudgetTrial]) -> TextTable {
    let mut table = TextTable::new(
        rows,
        &[
            ("scene", |row| row.trial.scene.clone()),
            ("variant", |row| row.trial.variant.clone()),
            ("seed", |row| row.trial.seed.to_string()),
            ("budget", |row| row.budget_seconds.to_string()),
            ("train_seconds", |row| row.trial.train_seconds.to_string()),
            ("iterations", |row| row.trial.iterations.to_string()),
        ],
    );
    for key in METRICS.iter().map(|metric| metric.key()) {
        let cell = |row: &BudgetTrial| row.trial.metric(key).map_or_else(String::new, |value| value.to_string());
        table.push_column(key, rows.iter().map(cell));
    }
    table
}

fn text(points: &[ParetoPoint], targets: &[TargetReached]) -> String {
    let mut table = TextTable::new(
        points,
        &[
            ("variant", |point| point.variant.clone()),
            ("budget", |point| format!("{} s", point.budget_seconds)),
            ("training", |point| format!("{:.1} s", point.train_seconds)),
            ("steps", |point| format!("{:.0}", point.iterations)),
            ("frontier", |point| if point.on_frontier { "*" } else { "" }.to_owned()),
        ],
    );
    for metric in METRICS.iter().filter(|metric| is_measured(points, metric)) {
        let cell = |point: &ParetoPoint| {
            let value = metric_of(&point.metrics, metric.key());
            value.map_or_else(|| "-".to_owned(), |value| metric.descriptor.format(value))
        };
        table.push_column(metric.descriptor.name, points.iter().map(cell));
    }
    let line = |TargetReached { variant, psnr, train_seconds }: &TargetReached| match train_seconds {
        Some(seconds) => format!("\n{variant}: past {psnr} dB after {seconds:.1} s of training"),
        None => format!("\n{variant}: {psnr} dB is not reached"),
    };
    format!("\n{}", table.to_text()) + &targets.iter().map(line).collect::<String>()
}
