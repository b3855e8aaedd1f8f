//! Every operation and loss on inputs that are hard on it, against the oracle in `f64`.

mod compositing;
mod divergence;
mod errors;
mod field;
mod geometry;
mod network;
mod rays;

use anyhow::{Context, Result};
use burn::tensor::{Device, FloatDType};
use fastrand::Rng;
use infonerf_experiment::{DeviceName, OpenDevice, open};
use infonerf_ops::has_host_kernels;
use infonerf_report::chart::{Frame, heat_map};
use serde::Serialize;

use super::context::{Bench, distinct};
use super::options::Options;
use super::output::TextTable;
use errors::Errors;

/// Rays of each family, unless told otherwise.
const RAYS: u32 = 55_000;
/// Largest relative error of a value.
const VALUE: f64 = 1e-5;
/// Largest error of a gradient, relative to the largest of its ray or table.
const GRADIENT: f64 = 1e-4;
const SEED: u64 = 4;

const PROTOCOL: &str = "single precision against f64 of the same f32 inputs (a network in bf16: against single precision); error of a value: |got - want|/|want| where |want| > \
                        1e-20; error of a gradient: the same relative to the largest gradient of its ray, or of its table, where \
                        that is above 1e-20; gradients with respect to optical depth, to tables and weights, or to colour; a \
                        slope that is infinite by definition (exact entropy of an empty sample) need only be finite";

/// A case whose bound is another one, and why.
struct Exception {
    operation: &'static str,
    case: &'static str,
    device: &'static str,
    value: f64,
    gradient: f64,
    why: &'static str,
}

/// Interpolation at a coordinate of 24 bits, and sums of terms of a thousand: x is known to 1e-6 of its terms, and where
/// they cancel so that softplus or sigmoid are at their exponential end, that is the relative error of σ or colour.
const CANCELLED: &str = "terms of 1e5 cancel within the MLP before an exponential";

/// A factor of 8 bits is off by up to 2⁻⁹. Values carry a few times that through the layers; gradients carry more, as their
/// sums cancel and some ReLUs switch sides.
const ROUNDED: &str = "factors of the matrix products have 8 bits";

const EXCEPTIONS: [Exception; 3] = [
    exception(network::OPERATION, network::CASE, "flex", (0.02, 0.3), ROUNDED),
    exception("factored field", "tables 1e3", "flex", (1.0, GRADIENT), CANCELLED),
    exception("factored field", "tables 1e3", "ndarray", (1.0, GRADIENT), CANCELLED),
];

const fn exception(
    operation: &'static str,
    case: &'static str,
    device: &'static str,
    (value, gradient): (f64, f64),
    why: &'static str,
) -> Exception {
    Exception { operation, case, device, value, gradient, why }
}

/// One operation on one kind of input.
#[derive(Serialize)]
struct Row {
    device: &'static str,
    operation: &'static str,
    case: String,
    rays: usize,
    #[serde(flatten)]
    errors: Errors,
    /// None on a GPU, which computes in single precision throughout and has no digits to spare where a case cancels: its
    /// errors are shown, and asked is that every number be finite.
    value_bound: Option<f64>,
    gradient_bound: Option<f64>,
    exception: Option<&'static str>,
    holds: bool,
}

impl Row {
    fn new(device: DeviceName, operation: &'static str, case: &str, rays: usize, errors: Errors) -> Self {
        let known = EXCEPTIONS.iter().find(|e| e.operation == operation && e.case == case && e.device == device.name());
        let (value, gradient) = known.map_or((VALUE, GRADIENT), |e| (e.value, e.gradient));
        let [value_bound, gradient_bound] = [value, gradient].map(|bound| device.is_cpu().then_some(bound));
        let within = |error: f64, bound: Option<f64>| bound.is_none_or(|bound| error <= bound);
        let holds =
            errors.non_finite == 0 && within(errors.value, value_bound) && within(errors.gradient, gradient_bound);
        let exception = known.map(|e| e.why);
        let device = device.name();
        Self { device, operation, case: case.to_owned(), rays, errors, value_bound, gradient_bound, exception, holds }
    }
}

#[derive(Serialize)]
struct Results<'a> {
    rays: usize,
    numbers: u64,
    non_finite: u64,
    rows: &'a [Row],
}

/// Whether every bound holds.
pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<bool> {
    let count = options.rays.unwrap_or(RAYS) as usize;
    let devices = if options.device == DeviceName::Auto { DeviceName::cpus().collect() } else { vec![options.device] };
    let mut rows = Vec::new();
    for name in devices {
        let OpenDevice { device, name, .. } = open(name)?;
        rows.extend(measure(bench, &device, name, count)?);
    }
    for device in distinct(&rows, |row| row.device) {
        let own: Vec<&Row> = rows.iter().filter(|row| row.device == device).collect();
        say(&text(device, &own));
        draw(bench, device, &own)?;
    }
    let numbers = rows.iter().map(|row| row.errors.numbers).sum();
    let non_finite = rows.iter().map(|row| row.errors.non_finite).sum();
    let rays = rows.iter().map(|row| row.rays).sum();
    bench.save_results(PROTOCOL, &Results { rays, numbers, non_finite, rows: &rows })?;
    bench.save_csv("stress", &table(&rows.iter().collect::<Vec<_>>()))?;
    let broken: Vec<&Row> = rows.iter().filter(|row| !row.holds).collect();
    if !broken.is_empty() {
        say(&format!("\nbroken bounds:\n{}", table(&broken).to_text()));
    }
    Ok(broken.is_empty())
}

fn measure(bench: &Bench, device: &Device, name: DeviceName, count: usize) -> Result<Vec<Row>> {
    let rng = &mut Rng::with_seed(SEED);
    let mut rows = Vec::new();
    for family in rays::FAMILIES {
        let rays = ((count as f64 * family.share) as usize).max(1);
        for (i, errors) in compositing::measure(&family, count, device, rng).into_iter().enumerate() {
            // The rays of a family are counted once.
            let rays = if i == 0 { rays } else { 0 };
            rows.push(Row::new(name, compositing::QUANTITIES[i], family.name, rays, errors));
        }
    }
    let pairs = count / 4;
    for relation in rays::RELATIONS {
        for (i, errors) in divergence::measure(&relation, pairs, device, rng).into_iter().enumerate() {
            let rays = if i == 0 { 2 * pairs } else { 0 };
            rows.push(Row::new(name, divergence::QUANTITIES[i], relation.name, rays, errors));
        }
    }
    let few = count / 20;
    for (case, draw) in field::COORDINATES {
        rows.push(Row::new(name, "encoding", case, 0, field::encoding(draw, few, device, rng)));
    }
    for (case, draw) in field::COORDINATES {
        rows.push(Row::new(name, "integrated encoding", case, 0, field::integrated(draw, few, device, rng)));
    }
    rows.push(Row::new(name, "frustums", "1e-6 to 1e6 units away", 0, field::frustums(count, device, rng)));
    for contents in field::CONTENTS {
        rows.push(Row::new(name, "factored field", contents.name, 0, field::field(&contents, few, device, rng)));
    }
    for (case, draw) in field::PLANES {
        rows.push(Row::new(name, "total variation", case, 0, field::variation(draw, count, device, rng)));
    }
    for (case, truth) in field::COLORS {
        rows.push(Row::new(name, "L_RGB", case, 0, field::photometric(truth, few, device, rng)));
    }
    let plan = bench.plans.first().context("expected at least one run to measure")?;
    for scale in geometry::SCALES {
        for (way, draw) in geometry::WAYS {
            let case = format!("{way}, scale {scale:e}");
            rows.push(Row::new(name, "bounds", &case, few, geometry::bounds(draw, scale, few, rng)));
            let errors = geometry::rendered(plan, device, draw, scale, few / 4, rng)?;
            rows.push(Row::new(name, "render", &case, few / 4, errors));
        }
    }
    if has_host_kernels(device) || device.supports_dtype(FloatDType::BF16) {
        let errors = network::rounded(few, device, rng);
        rows.push(Row::new(name, network::OPERATION, network::CASE, 0, errors));
    }
    Ok(rows)
}

fn table(rows: &[&Row]) -> TextTable {
    let mut table =
        TextTable::new(&["operation", "case", "device", "rays", "numbers", "not finite", "value", "gradient", "holds"]);
    for row in rows {
        let errors = &row.errors;
        let holds = if row.holds { "yes" } else { "NO" };
        table.row(vec![
            row.operation.into(),
            row.case.clone(),
            row.device.into(),
            row.rays.to_string(),
            errors.numbers.to_string(),
            errors.non_finite.to_string(),
            format!("{:.1e}", errors.value),
            format!("{:.1e}", errors.gradient),
            row.exception.map_or_else(|| holds.to_owned(), |why| format!("{holds}: {why}")),
        ]);
    }
    table
}

/// One line per operation: its worst case, and the exceptions below.
fn text(device: &str, rows: &[&Row]) -> String {
    let rays: usize = rows.iter().map(|row| row.rays).sum();
    let mut summary =
        TextTable::new(&["operation", "cases", "numbers", "not finite", "value", "(worst)", "gradient", "(worst)"]);
    for operation in distinct(rows, |row| row.operation) {
        let own: Vec<&&Row> = rows.iter().filter(|row| row.operation == operation).collect();
        let worst = |error: fn(&Errors) -> f64| {
            let row = own.iter().max_by(|a, b| error(&a.errors).total_cmp(&error(&b.errors)));
            row.map_or_else(Default::default, |row| (format!("{:.1e}", error(&row.errors)), row.case.clone()))
        };
        let ((value, of_value), (gradient, of_gradient)) = (worst(|e| e.value), worst(|e| e.gradient));
        summary.row(vec![
            operation.into(),
            own.len().to_string(),
            own.iter().map(|row| row.errors.numbers).sum::<u64>().to_string(),
            own.iter().map(|row| row.errors.non_finite).sum::<u64>().to_string(),
            value,
            of_value,
            gradient,
            of_gradient,
        ]);
    }
    let exceptions =
        rows.iter().filter_map(|row| Some(format!("exception: {}, {}: {}\n", row.operation, row.case, row.exception?)));
    format!("\n{device}: {rays} rays\n\n{}", summary.to_text()) + &exceptions.collect::<String>()
}

/// One of the errors of a row.
type Pick = fn(&Errors) -> f64;

/// log₁₀ of the errors of compositing, and of the divergence, by case and quantity.
fn draw(bench: &Bench, device: &str, rows: &[&Row]) -> Result<()> {
    let maps: [(&str, &[&str]); 2] =
        [("compositing", &compositing::QUANTITIES), ("divergence", &divergence::QUANTITIES)];
    let kinds: [(&str, Pick); 2] = [("value", |e| e.value), ("gradient", |e| e.gradient)];
    for (what, quantities) in maps {
        let own: Vec<&&Row> = rows.iter().filter(|row| quantities.contains(&row.operation)).collect();
        let cases = distinct(&own, |row| row.case.clone());
        for (kind, error) in kinds {
            let cell = |case: &String, quantity: &&str| {
                let row = own.iter().find(|row| row.case == *case && row.operation == *quantity)?;
                Some(error(&row.errors).max(1e-9).log10())
            };
            let line = |case| quantities.iter().map(|quantity| cell(case, quantity)).collect();
            let values: Vec<Vec<Option<f64>>> = cases.iter().map(line).collect();
            let title = format!("{what} on {device}: log10 of the largest relative {kind} error");
            let columns: Vec<String> = quantities.iter().map(|quantity| (*quantity).to_owned()).collect();
            let svg = heat_map(&Frame::new(&title, "", ""), &columns, &cases, &values)?;
            bench.save_chart(&format!("{what}-{kind}-{device}"), &svg)?;
        }
    }
    Ok(())
}
