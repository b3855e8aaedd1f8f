//! Errors of every operation and loss on extreme inputs, against the oracle in `f64`.

mod compositing;
mod divergence;
mod errors;
mod field;
mod geometry;
mod network;
mod rays;

use anyhow::Result;
use burn::tensor::FloatDType;
use fastrand::Rng;
use infonerf_experiment::{DeviceName, OpenDevice, open};
use infonerf_ops::has_host_kernels;
use infonerf_report::TextTable;
use serde::Serialize;
use serde_json::json;

use crate::context::{Bench, distinct};
use errors::Errors;

/// Maximum relative error of a value.
const VALUE: f64 = 1e-5;
/// Maximum error of a gradient, relative to the largest of its ray or table.
const GRADIENT: f64 = 1e-4;
const SEED: u64 = 4;

const PROTOCOL: &str = "single precision against f64 of the same f32 inputs (a network in bf16: against single precision); error of a value: |got - want|/|want| where |want| > \
                        1e-20; error of a gradient: the same relative to the largest gradient of its ray, or of its table, where \
                        that is above 1e-20; gradients with respect to optical depth, to tables and weights, or to colour; a \
                        gradient that is infinite by definition (exact entropy of an empty sample) need only be finite";

/// Reason for large errors of large tables: interpolation at a coordinate of 24 bits, and sums of terms of a thousand, know the
/// MLP's output to 1e-6 of its terms. Where these cancel before an exponential, this is the relative error of σ or colour.
const CANCELLED: &str = "terms of 1e5 cancel within the MLP before an exponential";

/// Reason for large errors of bf16: a factor of 8 bits is off by up to 2⁻⁹. Values carry a few times this error through the
/// layers. Gradients carry more, as their sums cancel and some ReLUs switch sides.
const ROUNDED: &str = "factors of the matrix products have 8 bits";

/// Operations and cases with bounds of their own: the devices that have them, the bounds, and the reason.
#[allow(clippy::type_complexity, reason = "a table")]
const EXCEPTIONS: [(&str, &str, &[&str], (f64, f64), &str); 2] = [
    (network::OPERATION, network::CASE, &["flex"], (0.02, 0.3), ROUNDED),
    ("factored field", "tables 1e3", &["flex", "ndarray"], (1.0, GRADIENT), CANCELLED),
];

#[derive(Serialize)]
struct StressCase {
    device: &'static str,
    operation: &'static str,
    case: String,
    rays: usize,
    #[serde(flatten)]
    errors: Errors,
    /// Bound of the value; `None` on a GPU, whose single precision loses digits where terms cancel: values need only be finite.
    value_bound: Option<f64>,
    gradient_bound: Option<f64>,
    exception: Option<&'static str>,
    holds: bool,
}

impl StressCase {
    fn new(device: DeviceName, operation: &'static str, case: &str, rays: usize, errors: Errors) -> Self {
        let known = EXCEPTIONS
            .into_iter()
            .find(|(known, of, devices, ..)| (*known, *of) == (operation, case) && devices.contains(&device.name()));
        let (bounds, exception) = known.map_or(((VALUE, GRADIENT), None), |(.., bounds, why)| (bounds, Some(why)));
        let (value, gradient) = bounds;
        let [value_bound, gradient_bound] = [value, gradient].map(|bound| device.is_cpu().then_some(bound));
        let fits = |error: f64, bound: Option<f64>| bound.is_none_or(|bound| error <= bound);
        let holds = errors.non_finite == 0 && fits(errors.value, value_bound) && fits(errors.gradient, gradient_bound);
        let device = device.name();
        Self { device, operation, case: case.to_owned(), rays, errors, value_bound, gradient_bound, exception, holds }
    }
}

/// Measures errors of every operation and loss on `count` extreme rays of each kind, on `device` or on every CPU device.
pub fn run(bench: &Bench, device: DeviceName, count: usize, print: &mut dyn FnMut(&str)) -> Result<bool> {
    print(&bench.machine());
    let devices = match device {
        DeviceName::Auto => DeviceName::BUILT_IN.iter().copied().filter(|device| device.is_cpu()).collect(),
        device => vec![device],
    };
    let mut rows = Vec::new();
    for name in devices {
        rows.extend(measure(bench, &open(name)?, count, print)?);
    }
    for device in distinct(&rows, |row| row.device) {
        let own: Vec<&StressCase> = rows.iter().filter(|row| row.device == device).collect();
        print(&text(device, &own));
    }
    let totals = json!({
        "rays": rows.iter().map(|row| row.rays).sum::<usize>(),
        "numbers": rows.iter().map(|row| row.errors.numbers).sum::<u64>(),
        "non_finite": rows.iter().map(|row| row.errors.non_finite).sum::<u64>(),
    });
    bench.save_results(PROTOCOL, &rows, totals)?;
    bench.save_csv(&table(&rows))?;
    let broken: Vec<&StressCase> = rows.iter().filter(|row| !row.holds).collect();
    if !broken.is_empty() {
        print(&format!("\nbroken bounds:\n{}", table(broken.iter().copied()).to_text()));
    }
    Ok(broken.is_empty())
}

fn measure(bench: &Bench, on: &OpenDevice, count: usize, print: &mut dyn FnMut(&str)) -> Result<Vec<StressCase>> {
    let (device, name) = (&on.device, on.name);
    let mut at = |operation: &str| print(&format!("{name}: {operation}"));
    let rng = &mut Rng::with_seed(SEED);
    let mut rows = Vec::new();
    // Rays are counted only once, with the first of their quantities.
    let cases = |quantities: &'static [&str], case, rays, errors: Vec<Errors>| {
        let case = move |(i, (of, errors))| StressCase::new(name, of, case, if i == 0 { rays } else { 0 }, errors);
        quantities.iter().copied().zip(errors).enumerate().map(case)
    };
    at("compositing");
    for (family, share, draw) in rays::FAMILIES {
        let rays = ((count as f64 * share) as usize).max(1);
        rows.extend(cases(&compositing::QUANTITIES, family, rays, compositing::measure(draw, rays, device, rng)));
    }
    at("divergence");
    let pairs = count / 4;
    for (relation, draw) in rays::RELATIONS {
        rows.extend(cases(&divergence::QUANTITIES, relation, 2 * pairs, divergence::measure(draw, pairs, device, rng)));
    }
    at("encodings, frustums and fields");
    let few = count / 20;
    let row = |of: &'static str, case: &str, errors: Errors| StressCase::new(name, of, case, 0, errors);
    let points = field::COORDINATES;
    rows.extend(points.map(|(case, of)| row("encoding", case, field::encoding(of, few, device, rng))));
    rows.extend(points.map(|(case, of)| row("integrated encoding", case, field::integrated(of, few, device, rng))));
    rows.push(row("frustums", "1e-6 to 1e6 units away", field::frustums(count, device, rng)));
    rows.extend(field::CONTENTS.map(|(case, of)| row("factored field", case, field::field(of, few, device, rng))));
    rows.extend(field::PLANES.map(|(case, of)| row("total variation", case, field::variation(of, count, device, rng))));
    rows.extend(field::COLORS.map(|(case, of)| row("L_RGB", case, field::photometric(of, few, device, rng))));
    at("bounds and renders");
    let plan = &bench.plans[0];
    for scale in geometry::SCALES {
        for (kind, draw) in geometry::RAY_KINDS {
            let case = format!("{kind}, scale {scale:e}");
            rows.push(StressCase::new(name, "bounds", &case, few, geometry::bounds(draw, scale, few, rng)));
            let errors = geometry::rendered(plan, device, draw, scale, few / 4, rng)?;
            rows.push(StressCase::new(name, "render", &case, few / 4, errors));
        }
    }
    if has_host_kernels(device) || device.supports_dtype(FloatDType::BF16) {
        rows.push(row(network::OPERATION, network::CASE, network::rounded(few, device, rng)));
    }
    Ok(rows)
}

fn table<'a>(rows: impl IntoIterator<Item = &'a StressCase>) -> TextTable {
    TextTable::new(
        rows,
        &[
            ("operation", |row: &StressCase| row.operation.into()),
            ("case", |row| row.case.clone()),
            ("device", |row| row.device.into()),
            ("rays", |row| row.rays.to_string()),
            ("values", |row| row.errors.numbers.to_string()),
            ("not finite", |row| row.errors.non_finite.to_string()),
            ("value", |row| format!("{:.1e}", row.errors.value)),
            ("gradient", |row| format!("{:.1e}", row.errors.gradient)),
            ("holds", |row| {
                let holds = if row.holds { "yes" } else { "NO" };
                row.exception.map_or_else(|| holds.to_owned(), |why| format!("{holds}: {why}"))
            }),
        ],
    )
}

/// Formats a line per operation with its worst cases, and the exceptions below.
fn text(device: &str, rows: &[&StressCase]) -> String {
    type Operation<'a> = (&'static str, Vec<&'a StressCase>);
    fn worst<'a>((_, cases): &Operation<'a>, error: fn(&Errors) -> f64) -> (String, &'a str) {
        let worst = cases.iter().max_by(|a, b| error(&a.errors).total_cmp(&error(&b.errors)));
        worst.map_or_else(Default::default, |row| (format!("{:.1e}", error(&row.errors)), row.case.as_str()))
    }
    let cases = |operation| rows.iter().copied().filter(|row| row.operation == operation).collect();
    let operations = distinct(rows, |row| row.operation).into_iter();
    let operations: Vec<Operation> = operations.map(|operation| (operation, cases(operation))).collect();
    let table = TextTable::new(
        &operations,
        &[
            ("operation", |(operation, _): &Operation| (*operation).into()),
            ("cases", |(_, cases)| cases.len().to_string()),
            ("values", |(_, cases)| cases.iter().map(|row| row.errors.numbers).sum::<u64>().to_string()),
            ("not finite", |(_, cases)| cases.iter().map(|row| row.errors.non_finite).sum::<u64>().to_string()),
            ("value", |operation| worst(operation, |errors| errors.value).0),
            ("(worst)", |operation| worst(operation, |errors| errors.value).1.into()),
            ("gradient", |operation| worst(operation, |errors| errors.gradient).0),
            ("(worst)", |operation| worst(operation, |errors| errors.gradient).1.into()),
        ],
    );
    let rays: usize = rows.iter().map(|row| row.rays).sum();
    let exceptions =
        rows.iter().filter_map(|row| Some(format!("exception: {}, {}: {}\n", row.operation, row.case, row.exception?)));
    format!("\n{device}: {rays} rays\n\n{}", table.to_text()) + &exceptions.collect::<String>()
}
