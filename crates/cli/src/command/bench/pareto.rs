//! Quality against training time: every variant with every budget, each a run of its own.

use anyhow::Result;
use infonerf_report::chart::{Axis, Frame, Series, pareto_frontier, scatter_chart};
use serde::Serialize;

use super::args::BenchArgs;
use super::context::{Bench, distinct};
use super::output::{TextTable, number};
use super::trial::{Trial, mean};
use crate::experiment::RunPlan;

/// PSNR of InfoNeRF on lego in the paper is 18.92 dB.
const TARGET: f64 = 18.9;

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
    psnr: f64,
    ssim: Option<f64>,
    gmsd: f64,
    sharpness: Option<f64>,
    on_frontier: bool,
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

pub(super) fn run(bench: &Bench, args: &BenchArgs) -> Result<()> {
    println!();
    let mut rows: Vec<Row> = Vec::new();
    for plan in &bench.plans {
        for budget in &args.budgets {
            let budget = budget.as_secs_f64();
            let trial = bench.trial(&RunPlan { budget: Some(budget), ..plan.clone() })?;
            println!("{} in {budget} s: {:.2} dB after {} steps", plan.label(), trial.psnr, trial.iterations);
            rows.push(Row { budget_seconds: budget, trial });
            // What is done so far stays if the rest is interrupted.
            save(bench, &rows)?;
        }
    }
    print(&points(&rows), &passed(&rows));
    Ok(())
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
            psnr: required(|trial| trial.psnr),
            ssim: mean(&trials, |trial| trial.ssim),
            gmsd: required(|trial| trial.gmsd),
            sharpness: mean(&trials, |trial| trial.sharpness),
            on_frontier: false,
            variant,
        }
    };
    let mut points: Vec<Point> = keys.into_iter().map(point).collect();
    let all: Vec<(f64, f64)> = points.iter().map(|point| (point.train_seconds, point.psnr)).collect();
    let frontier = pareto_frontier(&all);
    for (point, place) in points.iter_mut().zip(all) {
        point.on_frontier = frontier.contains(&place);
    }
    points
}

fn passed(rows: &[Row]) -> Vec<Passed> {
    let points = points(rows);
    let first = |variant: String| {
        let past = points.iter().filter(|point| point.variant == variant && point.psnr >= TARGET);
        let train_seconds = past.map(|point| point.train_seconds).min_by(f64::total_cmp);
        Passed { variant, psnr: TARGET, train_seconds }
    };
    distinct(&points, |point| point.variant.clone()).into_iter().map(first).collect()
}

fn save(bench: &Bench, rows: &[Row]) -> Result<()> {
    let points = points(rows);
    bench.save_results(PROTOCOL, &Results { rows, points: &points, passed: &passed(rows) })?;
    bench.save_csv("pareto", &csv(rows))?;
    for (name, label, value) in [
        ("psnr", "PSNR (dB)", (|point| Some(point.psnr)) as fn(&Point) -> Option<f64>),
        ("ssim", "SSIM", |point| point.ssim),
    ] {
        let frame = Frame {
            title: format!("Training time against {label}"),
            x: Axis::log("training (s)"),
            y: Axis::linear(label),
        };
        let of = |name: String| {
            let own = points.iter().filter(|point| point.variant == name);
            let points = own.filter_map(|point| Some((point.train_seconds, value(point)?))).collect();
            Series { name, points }
        };
        let series: Vec<Series> = distinct(&points, |point| point.variant.clone()).into_iter().map(of).collect();
        bench.save_chart(&format!("pareto-{name}"), &scatter_chart(&frame, &series, true)?)?;
    }
    Ok(())
}

fn csv(rows: &[Row]) -> TextTable {
    let mut table = TextTable::new(&[
        "scene",
        "variant",
        "seed",
        "budget",
        "train_seconds",
        "iterations",
        "psnr",
        "ssim",
        "gmsd",
        "sharpness",
    ]);
    let optional = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    for Row { budget_seconds, trial } in rows {
        table.row(vec![
            trial.scene.clone(),
            trial.variant.clone(),
            trial.seed.to_string(),
            budget_seconds.to_string(),
            trial.train_seconds.to_string(),
            trial.iterations.to_string(),
            trial.psnr.to_string(),
            optional(trial.ssim),
            trial.gmsd.to_string(),
            optional(trial.sharpness),
        ]);
    }
    table
}

fn print(points: &[Point], passed: &[Passed]) {
    let mut table =
        TextTable::new(&["variant", "budget", "training", "steps", "PSNR", "SSIM", "GMSD", "sharpness", "frontier"]);
    for point in points {
        table.row(vec![
            point.variant.clone(),
            format!("{} s", point.budget_seconds),
            format!("{:.1} s", point.train_seconds),
            format!("{:.0}", point.iterations),
            format!("{:.2}", point.psnr),
            number(point.ssim, 4),
            format!("{:.4}", point.gmsd),
            number(point.sharpness, 3),
            if point.on_frontier { "*" } else { "" }.to_owned(),
        ]);
    }
    println!("\n{}", table.to_text());
    for Passed { variant, psnr, train_seconds } in passed {
        match train_seconds {
            Some(seconds) => println!("{variant}: past {psnr} dB after {seconds:.1} s of training"),
            None => println!("{variant}: {psnr} dB is not reached"),
        }
    }
}
