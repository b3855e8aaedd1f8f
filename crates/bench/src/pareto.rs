//! Quality against training time: every variant with every budget, each a run of its own, beside what others report.

use anyhow::Result;
use infonerf_metrics::{LPIPS_ALEX, LPIPS_VGG, METRICS, Metric, PSNR, SSIM, Values};
use infonerf_report::chart::{Axis, Frame, Series, marked_chart, pareto_frontier};
use serde::Serialize;

use super::context::{Bench, distinct};
use super::options::Options;
use super::output::TextTable;
use super::published::Published;
use super::trial::{Trial, mean, mean_metrics};
use infonerf_experiment::RunPlan;

/// PSNR of InfoNeRF on lego in the paper is 18.92 dB.
const TARGET: f64 = 18.9;

/// Metrics with a chart of their own.
const CHARTS: [Metric; 4] = [PSNR, SSIM, LPIPS_ALEX, LPIPS_VGG];

const PROTOCOL: &str = "each row is an independent run whose schedule follows the clock; train_seconds is training alone, \
                        without loading and evaluation; points are means over scenes and seeds";

#[derive(Serialize)]
struct Row {
    budget_seconds: f64,
    #[serde(flatten)]
    trial: Trial,
}

/// Mean over scenes and seeds.
#[derive(Serialize)]
struct Point {
    variant: String,
    budget_seconds: f64,
    train_seconds: f64,
    iterations: f64,
    on_frontier: bool,
    /// The metrics that every run has.
    #[serde(flatten)]
    metrics: Values,
}

impl Point {
    fn metric(&self, key: &str) -> Option<f64> {
        self.metrics.get(key).copied().flatten()
    }

    fn psnr(&self) -> f64 {
        self.metric("psnr").unwrap_or(f64::NAN)
    }
}

/// When a variant first reaches [`TARGET`].
#[derive(Serialize)]
struct Passed {
    variant: String,
    psnr: f64,
    /// Mean training time of the smallest budget that did; none if none did.
    train_seconds: Option<f64>,
}

#[derive(Serialize)]
struct Results<'a> {
    rows: &'a [Row],
    points: &'a [Point],
    passed: &'a [Passed],
}

pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<()> {
    say("");
    let mut rows: Vec<Row> = Vec::new();
    for plan in &bench.plans {
        for budget in &options.budgets {
            let budget = budget.as_secs_f64();
            let trial = bench.trial(&RunPlan { budget: Some(budget), ..plan.clone() })?;
            let (label, psnr, steps) = (plan.label(), trial.psnr(), trial.iterations);
            say(&format!("{label} in {budget} s: {psnr:.2} dB after {steps} steps"));
            rows.push(Row { budget_seconds: budget, trial });
            // What is done so far stays if the rest is interrupted.
            save(bench, &rows)?;
        }
    }
    say(&text(&points(&rows), &passed(&rows)));
    let (scenes, views) = beside(bench, &rows);
    Published::read()?.lines(&scenes, &views).iter().for_each(|line| say(line));
    Ok(())
}

/// The scenes and numbers of training views that others' figures have to be of; no scene of a published data set for
/// procedural ones.
fn beside(bench: &Bench, rows: &[Row]) -> (Vec<String>, Vec<usize>) {
    let published = bench.plans.iter().all(|plan| plan.data.is_some());
    let scene = |row: &Row| if published { row.trial.scene.clone() } else { String::new() };
    (distinct(rows, scene), distinct(rows, |row| row.trial.train_views))
}

fn points(rows: &[Row]) -> Vec<Point> {
    let keys = distinct(rows, |row| (row.trial.variant.clone(), row.budget_seconds));
    let point = |(variant, budget): (String, f64)| {
        let same = |row: &&Row| row.trial.variant == variant && row.budget_seconds == budget;
        let trials: Vec<&Trial> = rows.iter().filter(same).map(|row| &row.trial).collect();
        let required = |value: fn(&Trial) -> f64| mean(&trials, |trial| Some(value(trial))).unwrap_or(f64::NAN);
        Point {
            budget_seconds: budget,
            train_seconds: required(|trial| trial.train_seconds),
            iterations: required(|trial| trial.iterations as f64),
            metrics: mean_metrics(&trials),
            on_frontier: false,
            variant,
        }
    };
    let mut points: Vec<Point> = keys.into_iter().map(point).collect();
    let all: Vec<(f64, f64)> = points.iter().map(|point| (point.train_seconds, point.psnr())).collect();
    let frontier = pareto_frontier(&all);
    for (point, place) in points.iter_mut().zip(all) {
        point.on_frontier = frontier.contains(&place);
    }
    points
}

fn passed(rows: &[Row]) -> Vec<Passed> {
    let points = points(rows);
    let first = |variant: String| {
        let past = points.iter().filter(|point| point.variant == variant && point.psnr() >= TARGET);
        let train_seconds = past.map(|point| point.train_seconds).min_by(f64::total_cmp);
        Passed { variant, psnr: TARGET, train_seconds }
    };
    distinct(&points, |point| point.variant.clone()).into_iter().map(first).collect()
}

fn save(bench: &Bench, rows: &[Row]) -> Result<()> {
    let points = points(rows);
    bench.save_results(PROTOCOL, &Results { rows, points: &points, passed: &passed(rows) })?;
    bench.save_csv("pareto", &csv(rows))?;
    let (published, (scenes, views)) = (Published::read()?, beside(bench, rows));
    let all = distinct(rows, |row| row.trial.scene.clone());
    for metric in CHARTS.iter().filter(|metric| points.iter().any(|point| point.metric(metric.key()).is_some())) {
        let name = metric.key();
        let cores = bench.about.cores;
        let frame = Frame {
            title: format!("{} over training time, {}, {cores} CPU cores", metric.descriptor.name, all.join(", ")),
            x: Axis::log("training (s)"),
            y: Axis::linear(metric.descriptor.heading().trim_end_matches([' ', '↑', '↓'])),
        };
        let of = |name: String| {
            let own = points.iter().filter(|point| point.variant == name);
            let points = own.filter_map(|point| Some((point.train_seconds, point.metric(metric.key())?))).collect();
            Series { name, points }
        };
        let series: Vec<Series> = distinct(&points, |point| point.variant.clone()).into_iter().map(of).collect();
        let marks = published.marks(&scenes, &views, name);
        bench.save_drawing(&format!("pareto-{name}"), &marked_chart(&frame, &series, &marks)?)?;
    }
    Ok(())
}

fn csv(rows: &[Row]) -> TextTable {
    let keys = METRICS.iter().map(|metric| metric.key());
    let headings: Vec<&str> =
        ["scene", "variant", "seed", "budget", "train_seconds", "iterations"].into_iter().chain(keys.clone()).collect();
    let mut table = TextTable::new(&headings);
    let optional = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    for Row { budget_seconds, trial } in rows {
        let run = [
            trial.scene.clone(),
            trial.variant.clone(),
            trial.seed.to_string(),
            budget_seconds.to_string(),
            trial.train_seconds.to_string(),
            trial.iterations.to_string(),
        ];
        table.row(run.into_iter().chain(keys.clone().map(|key| optional(trial.metric(key)))).collect());
    }
    table
}

fn text(points: &[Point], passed: &[Passed]) -> String {
    let measured = |metric: &&&Metric| points.iter().any(|point| point.metric(metric.key()).is_some());
    let metrics: Vec<&Metric> = METRICS.iter().filter(measured).copied().collect();
    let names = metrics.iter().map(|metric| metric.descriptor.name);
    let headings: Vec<&str> = ["variant", "budget", "training", "steps", "frontier"].into_iter().chain(names).collect();
    let mut table = TextTable::new(&headings);
    for point in points {
        let shown = |metric: &&Metric| {
            point.metric(metric.key()).map_or_else(|| "-".to_owned(), |value| metric.descriptor.format(value))
        };
        let run = [
            point.variant.clone(),
            format!("{} s", point.budget_seconds),
            format!("{:.1} s", point.train_seconds),
            format!("{:.0}", point.iterations),
            if point.on_frontier { "*" } else { "" }.to_owned(),
        ];
        table.row(run.into_iter().chain(metrics.iter().map(shown)).collect());
    }
    let line = |Passed { variant, psnr, train_seconds }: &Passed| match train_seconds {
        Some(seconds) => format!("\n{variant}: past {psnr} dB after {seconds:.1} s of training"),
        None => format!("\n{variant}: {psnr} dB is not reached"),
    };
    format!("\n{}", table.to_text()) + &passed.iter().map(line).collect::<String>()
}
