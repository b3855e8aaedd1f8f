//! Quality against training time: every variant with every budget, each an independent run, next to published systems.

use std::time::Duration;

use anyhow::Result;
use infonerf_experiment::RunPlan;
use infonerf_metrics::{LPIPS_ALEX, LPIPS_VGG, METRICS, Metric, PSNR, SSIM, Values};
use infonerf_report::chart::{Axis, ChartFrame, Series, line_chart, pareto_frontier};
use infonerf_report::{Record, TextTable};
use serde::Serialize;
use serde_json::json;

use crate::context::{Bench, distinct};
use crate::output::number;
use crate::published::PublishedFigures;
use crate::trial::mean;

/// Metrics with a chart of their own.
const CHARTS: [Metric; 4] = [PSNR, SSIM, LPIPS_ALEX, LPIPS_VGG];

const PROTOCOL: &str = "each row is an independent run whose schedule follows the clock; train_seconds is training alone, \
                        without loading and evaluation; points are means over scenes and seeds";

#[derive(Serialize)]
struct BudgetTrial {
    budget_seconds: f64,
    #[serde(flatten)]
    record: Record,
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

fn value(metrics: &Values, metric: &Metric) -> Option<f64> {
    metrics.get(metric.key()).copied().flatten()
}

impl ParetoPoint {
    fn psnr(&self) -> f64 {
        value(&self.metrics, &PSNR).unwrap_or(f64::NAN)
    }
}

pub(crate) fn run(bench: &Bench, budgets: &[Duration], print: &mut dyn FnMut(&str)) -> Result<()> {
    print("");
    let mut rows: Vec<BudgetTrial> = Vec::new();
    for plan in &bench.plans {
        for budget in budgets {
            let budget = budget.as_secs_f64();
            let record = bench.trial(&RunPlan { budget: Some(budget), ..plan.clone() })?;
            let (label, psnr, steps) = (plan.label(), number(value(&record.metrics, &PSNR), 2), record.iterations);
            print(&format!("{label} in {budget} s: {psnr} dB after {steps} steps"));
            rows.push(BudgetTrial { budget_seconds: budget, record });
            save(bench, &rows)?;
        }
    }
    let points = points(&rows);
    print(&text(&points));
    let (scenes, views) = scenes_and_views(bench, &rows);
    PublishedFigures::read()?.lines(&scenes, &views).iter().for_each(|line| print(line));
    Ok(())
}

/// Lists scenes and numbers of training views that published figures must match; procedural scenes have no name there.
fn scenes_and_views(bench: &Bench, rows: &[BudgetTrial]) -> (Vec<String>, Vec<usize>) {
    let published = bench.plans.iter().all(|plan| plan.data.is_some());
    let scene = |row: &BudgetTrial| if published { row.record.scene.clone() } else { String::new() };
    (distinct(rows, scene), distinct(rows, |row| row.record.train_views.len()))
}

fn points(rows: &[BudgetTrial]) -> Vec<ParetoPoint> {
    let keys = distinct(rows, |row| (row.record.variant.clone(), row.budget_seconds));
    let point = |(variant, budget_seconds): (String, f64)| {
        let same = |row: &&BudgetTrial| row.record.variant == variant && row.budget_seconds == budget_seconds;
        let records: Vec<&Record> = rows.iter().filter(same).map(|row| &row.record).collect();
        let required = |of: fn(&Record) -> f64| mean(&records, |record| Some(of(record))).unwrap_or(f64::NAN);
        let metric =
            |metric: &&Metric| (metric.key().to_owned(), mean(&records, |record| value(&record.metrics, metric)));
        ParetoPoint {
            budget_seconds,
            train_seconds: required(|record| record.train_seconds),
            iterations: required(|record| record.iterations as f64),
            metrics: METRICS.iter().map(metric).collect(),
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

/// Writes all results so far, which stay if the rest is interrupted.
fn save(bench: &Bench, rows: &[BudgetTrial]) -> Result<()> {
    let points = points(rows);
    bench.save_results(PROTOCOL, rows, json!({ "points": points }))?;
    bench.save_csv(&csv(rows))?;
    let (published, (scenes, views)) = (PublishedFigures::read()?, scenes_and_views(bench, rows));
    let all = distinct(rows, |row| row.record.scene.clone()).join(", ");
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
            let points = own.filter_map(|point| Some((point.train_seconds, value(&point.metrics, metric)?))).collect();
            Series { name, points }
        };
        let own = distinct(&points, |point| point.variant.clone()).into_iter().map(series);
        let series: Vec<Series> = own.chain(published.series(&scenes, &views, key)).collect();
        bench.save_chart(&format!("pareto-{key}"), &line_chart(&frame, &series)?)?;
    }
    Ok(())
}

fn is_measured(points: &[ParetoPoint], metric: &Metric) -> bool {
    points.iter().any(|point| value(&point.metrics, metric).is_some())
}

fn csv(rows: &[BudgetTrial]) -> TextTable {
    let mut table = TextTable::new(
        rows,
        &[
            ("scene", |row| row.record.scene.clone()),
            ("variant", |row| row.record.variant.clone()),
            ("seed", |row| row.record.seed.to_string()),
            ("budget", |row| row.budget_seconds.to_string()),
            ("train_seconds", |row| row.record.train_seconds.to_string()),
            ("iterations", |row| row.record.iterations.to_string()),
        ],
    );
    for metric in METRICS {
        let cell = |row: &BudgetTrial| value(&row.record.metrics, metric).map_or_else(String::new, |of| of.to_string());
        table.push_column(metric.key(), rows.iter().map(cell));
    }
    table
}

fn text(points: &[ParetoPoint]) -> String {
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
            value(&point.metrics, metric).map_or_else(|| "-".to_owned(), |of| metric.descriptor.format(of))
        };
        table.push_column(metric.descriptor.name, points.iter().map(cell));
    }
    format!("\n{}", table.to_text())
}
