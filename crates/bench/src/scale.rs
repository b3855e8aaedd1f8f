//! How cost grows: rays, samples, resolution and image size, each doubled four times.

use anyhow::{Context, Result};
use infonerf_report::chart::{Frame, PowerLaw, Series, fit_power_law, power_law_chart};
use infonerf_train::Config;
use serde::Serialize;
use toml::{Table, Value};

use super::context::Bench;
use super::options::Options;
use super::output::{TextTable, median};
use super::render::{frames, trained};
use super::trial::{step_seconds, with_settings};
use infonerf_experiment::RunPlan;

const STEPS: u32 = 8;
const WARMUP: u32 = 2;
/// Steps of training before images are rendered.
const IMAGE_STEPS: u32 = 200;
/// Longest sides of the images, pixels.
const IMAGE_SIZES: [u32; 5] = [50, 100, 200, 400, 800];
/// Doublings of each quantity.
const DOUBLINGS: u32 = 4;

/// Nothing is skipped and nothing changes over the run, so that the work is what was asked for.
const DENSE: [&str; 5] = [
    "render.occupancy.enabled=false",
    "render.hidden_depth=0",
    "train.target_samples=0",
    "train.downscale=1",
    "train.iterations=1000000",
];

const PROTOCOL: &str = "milliseconds are medians over steps after a warm-up, with all skipping in training off; the largest \
                        number of rays and of samples is the configured one; where another quantity grows, rays are a \
                        quarter of it; images are rendered after a short training, with skipping as configured";

/// One quantity that grows.
#[derive(Serialize)]
struct Row {
    quantity: &'static str,
    unit: &'static str,
    points: Vec<Point>,
    /// Of the cost as a power of the quantity.
    exponent: Option<f64>,
}

#[derive(Serialize)]
struct Point {
    value: f64,
    milliseconds: f64,
}

#[derive(Serialize)]
struct Results<'a> {
    run: String,
    rows: &'a [Row],
}

/// A quantity, and the settings for each of its values.
struct Growth {
    quantity: &'static str,
    cases: Vec<(f64, Vec<String>)>,
}

pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<()> {
    let plan = bench.plans.first().context("expected a run to measure")?;
    let (steps, warmup) = (options.steps.unwrap_or(STEPS) as usize, options.warmup.unwrap_or(WARMUP) as usize);
    let mut rows = Vec::new();
    for Growth { quantity, cases } in [rays(&plan.config), samples(&plan.config), size(&plan.config)?] {
        let mut points = Vec::new();
        for (value, settings) in cases {
            let samples = format!("render.samples={}", plan.config.render.samples.largest());
            let settings: Vec<String> = DENSE.iter().map(|&s| s.to_owned()).chain([samples]).chain(settings).collect();
            let plan = with_settings(plan, &settings).with_context(|| format!("{quantity} {value}"))?;
            points.push(Point { value, milliseconds: step_ms(bench, &plan, warmup, steps)? });
        }
        rows.push(finish(bench, quantity, "ms per step", points, say)?);
    }
    rows.push(finish(bench, "image size", "ms per frame", images(bench, plan)?, say)?);
    bench.save_results(PROTOCOL, &Results { run: plan.label(), rows: &rows })
}

fn doubled(first: usize) -> impl Iterator<Item = usize> {
    (0..=DOUBLINGS).map(move |k| first << k)
}

fn rays(config: &Config) -> Growth {
    let train = &config.train;
    let cases = doubled((train.rays >> DOUBLINGS).max(1)).map(|rays| {
        let unseen = rays * train.unseen_rays / train.rays;
        (rays as f64, vec![format!("train.rays={rays}"), format!("train.unseen_rays={unseen}")])
    });
    Growth { quantity: "rays", cases: cases.collect() }
}

/// A quarter of the configured rays.
fn few_rays(config: &Config) -> Vec<String> {
    let quarter = |rays: usize| (rays / 4).max(1);
    let unseen = if config.train.unseen_rays > 0 { quarter(config.train.unseen_rays) } else { 0 };
    vec![format!("train.rays={}", quarter(config.train.rays)), format!("train.unseen_rays={unseen}")]
}

fn samples(config: &Config) -> Growth {
    let render = &config.render;
    let most = render.samples.largest() as usize;
    let cases = doubled((most >> DOUBLINGS).max(4)).map(|samples| {
        let fine = samples * render.fine_samples / most;
        let mut settings = few_rays(config);
        settings.extend([format!("render.samples={samples}"), format!("render.fine_samples={fine}")]);
        ((samples + fine) as f64, settings)
    });
    Growth { quantity: "samples per ray", cases: cases.collect() }
}

/// Resolution of a field with tables, else the width of its network; a quarter to four times the configured one.
fn size(config: &Config) -> Result<Growth> {
    let field = Table::try_from(&config.field)?;
    let quarter = |value: &Value| value.as_integer().map_or(2, |value| (value / 4).max(2)) as usize;
    let (quantity, key, smallest) = match field.get("resolutions") {
        Some(Value::Array(levels)) => ("field resolution", "field.resolutions", levels.iter().map(quarter).collect()),
        _ => ("field width", "field.width", vec![field.get("width").map_or(2, quarter)]),
    };
    let smallest: Vec<usize> = smallest;
    let cases = (0..=DOUBLINGS).map(|k| {
        let sizes: Vec<usize> = smallest.iter().map(|size| size << k).collect();
        let largest = sizes.iter().copied().max().unwrap_or(1);
        let mut settings = few_rays(config);
        settings.push(if key.ends_with('s') { format!("{key}={sizes:?}") } else { format!("{key}={largest}") });
        (largest as f64, settings)
    });
    Ok(Growth { quantity, cases: cases.collect() })
}

fn step_ms(bench: &Bench, plan: &RunPlan, warmup: usize, steps: usize) -> Result<f64> {
    let mut trainer = bench.trainer(plan)?;
    step_seconds(&mut trainer, warmup)?;
    Ok(1e3 * median(&step_seconds(&mut trainer, steps)?))
}

fn images(bench: &Bench, plan: &RunPlan) -> Result<Vec<Point>> {
    let trainer = trained(bench, plan, IMAGE_STEPS)?;
    let point = |row: super::render::Row| Point {
        value: f64::from(row.width.max(row.height)),
        milliseconds: 1e3 * row.seconds_per_frame,
    };
    Ok(frames(&trainer, plan, &IMAGE_SIZES)?.into_iter().map(point).collect())
}

/// Fits, draws and prints one quantity.
fn finish(
    bench: &Bench,
    quantity: &'static str,
    unit: &'static str,
    points: Vec<Point>,
    say: &mut dyn FnMut(&str),
) -> Result<Row> {
    let pairs: Vec<(f64, f64)> = points.iter().map(|point| (point.value, point.milliseconds)).collect();
    let law: Option<PowerLaw> = fit_power_law(&pairs);
    let frame = Frame::new(&format!("Cost by {quantity}"), quantity, unit);
    let series = [Series { name: unit.to_owned(), points: pairs }];
    bench.save_chart(&format!("scale-{}", quantity.replace(' ', "-")), &power_law_chart(&frame, &series)?)?;
    let mut table = TextTable::new(&[quantity, unit]);
    for point in &points {
        table.row(vec![point.value.to_string(), format!("{:.2}", point.milliseconds)]);
    }
    say(&format!("\n{}", table.to_text().trim_end()));
    let exponent = law.map(|law| law.exponent);
    if let Some(exponent) = exponent {
        say(&format!("grows as {quantity}^{exponent:.2}"));
    }
    Ok(Row { quantity, unit, points, exponent })
}
