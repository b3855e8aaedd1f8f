//! A device against flex, the CPU's backend whose kernels are held to the oracle: operations and their gradients, gradients of
//! whole steps of every kind of field, and a few steps of training.

mod networks;
mod operations;
mod training;

use anyhow::{Context, Result, ensure};
use infonerf_experiment::{DeviceName, open};
use serde::Serialize;

use super::context::Bench;
use super::options::Options;
use super::output::TextTable;
use training::{Course, KINDS, STEPS};

/// Largest error of a gradient of a whole step over the largest of its parameter: a sum over many samples in another order.
const GRADIENT: f64 = 2e-3;
/// Largest relative error of a loss in the steps that follow: Adam divides by the size of gradients, which lets small
/// differences grow.
const LOSS: f64 = 1e-2;
/// Losses below this are not asked for their digits.
const LEAST_LOSS: f64 = 0.01;
/// Largest mean difference of a picture's numbers after those steps.
const COLOR: f64 = 5e-3;

const PROTOCOL: &str = "a device against flex on the same inputs; error of an operation or gradient: the largest |got - want| over \
                        the largest |want| of its array; of a loss: |got - want|/max(|want|, 0.01), the largest of all steps and terms; \
                        of a picture: the mean |got - want| of its numbers in [0, 1]";

/// One quantity.
#[derive(Serialize)]
struct Row {
    what: String,
    of: String,
    numbers: usize,
    /// None where numbers are missing, all 0 or not finite.
    error: Option<f64>,
    bound: f64,
    holds: bool,
}

impl Row {
    fn new(what: &str, of: String, numbers: usize, error: Option<f64>, bound: f64) -> Self {
        let error = error.filter(|error| error.is_finite());
        Self { what: what.into(), of, numbers, error, bound, holds: error.is_some_and(|error| error <= bound) }
    }
}

#[derive(Serialize)]
struct Results<'a> {
    against: &'static str,
    adapter: Option<&'a str>,
    rows: &'a [Row],
}

/// Whether every bound holds.
pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<bool> {
    let (device, flex) = (open(options.device)?, open(DeviceName::Flex)?);
    ensure!(
        device.name != flex.name,
        "--device {}: agreement is with flex; expected another device that is built in",
        options.device
    );
    let plan = bench.plans.first().context("expected at least one run to measure")?;
    let mut rows = Vec::new();
    let save = |rows: &[Row]| {
        // What is done so far stays if the rest is interrupted.
        bench.save_results(PROTOCOL, &Results { against: flex.name.name(), adapter: device.adapter.as_deref(), rows })
    };
    for operation in operations::all() {
        let (got, want) = ((operation.answer)(&device.device), (operation.answer)(&flex.device));
        rows.extend(want.iter().enumerate().map(|(place, want)| {
            let of = if place == 0 { "value".to_owned() } else { format!("gradient {place}") };
            let error = got.get(place).and_then(|got| largest_difference(got, want));
            Row::new(&operation.name, of, want.len(), error, operation.bound)
        }));
        save(&rows)?;
    }
    for kind in &KINDS {
        let [got, want] = [&device.device, &flex.device].map(|device| kind.gradients(plan, device));
        let (got, want) = (got?, want?);
        let of = format!("gradients of {} parameters", want.len());
        let numbers = want.iter().map(Vec::len).sum();
        rows.push(Row::new(&format!("{}, a step", kind.name), of, numbers, worst(&got, &want), GRADIENT));
        let [got, want] = [&device.device, &flex.device].map(|device| kind.course(plan, device));
        let (got, want) = (got?, want?);
        let what = format!("{}, {STEPS} steps", kind.name);
        let numbers = want.losses.iter().map(|losses| losses.len()).sum();
        rows.push(Row::new(&what, "losses".into(), numbers, losses_apart(&got, &want), LOSS));
        let apart = mean_difference(&got.picture, &want.picture);
        rows.push(Row::new(&what, "picture".into(), want.picture.len(), apart, COLOR));
        save(&rows)?;
    }
    let table = table(&rows);
    say(&format!("\n{}", table.to_text()));
    bench.save_csv("agreement", &table)?;
    let broken = rows.iter().filter(|row| !row.holds).count();
    say(&format!("{} of {} agree with {}", rows.len() - broken, rows.len(), flex.name));
    Ok(broken == 0)
}

/// The largest [`largest_difference`] of several arrays; none where they differ in number or length, or all is 0.
fn worst(got: &[Vec<f32>], want: &[Vec<f32>]) -> Option<f64> {
    if got.len() != want.len() || want.iter().flatten().all(|want| *want == 0.0) {
        return None;
    }
    got.iter().zip(want).try_fold(0.0, |worst, (got, want)| Some(worse(worst, largest_difference(got, want)?)))
}

/// The larger of two errors, or NaN if either is, which `f64::max` would pass over.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// max |got − want| / max |want|; none where the arrays differ in length or are empty.
fn largest_difference(got: &[f32], want: &[f32]) -> Option<f64> {
    let largest = want.iter().map(|want| want.abs()).fold(f32::MIN_POSITIVE, f32::max);
    let apart = got.iter().zip(want).map(|(got, want)| f64::from(got - want).abs());
    (got.len() == want.len() && !want.is_empty()).then(|| apart.fold(0.0, worse) / f64::from(largest))
}

/// mean |got − want|; none where the arrays differ in length.
fn mean_difference(got: &[f32], want: &[f32]) -> Option<f64> {
    let sum: f64 = got.iter().zip(want).map(|(got, want)| f64::from(got - want).abs()).sum();
    (got.len() == want.len() && !want.is_empty()).then(|| sum / want.len() as f64)
}

/// The largest relative difference of all losses of all steps; none where steps or terms differ.
fn losses_apart(got: &Course, want: &Course) -> Option<f64> {
    if got.losses.len() != want.losses.len() {
        return None;
    }
    let mut worst: f64 = 0.0;
    for (got, want) in got.losses.iter().zip(&want.losses) {
        if !got.keys().eq(want.keys()) {
            return None;
        }
        for (got, want) in got.values().zip(want.values()) {
            let (got, want) = (f64::from(*got), f64::from(*want));
            worst = worse(worst, (got - want).abs() / want.abs().max(LEAST_LOSS));
        }
    }
    Some(worst)
}

fn table(rows: &[Row]) -> TextTable {
    let mut table = TextTable::new(&["what", "of", "numbers", "error", "bound", "holds"]);
    for row in rows {
        table.row(vec![
            row.what.clone(),
            row.of.clone(),
            row.numbers.to_string(),
            row.error.map_or_else(|| "none".into(), |error| format!("{error:.1e}")),
            format!("{:.0e}", row.bound),
            if row.holds { "yes" } else { "NO" }.into(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_relative_to_the_largest_and_nan_is_seen() {
        assert_eq!(largest_difference(&[1.0, 3.0], &[2.0, 4.0]), Some(0.25));
        assert_eq!(largest_difference(&[1.0], &[1.0, 2.0]), None);
        assert_eq!(largest_difference(&[], &[]), None);
        let nan = largest_difference(&[f32::NAN, 1.0, 2.0], &[1.0, 1.0, 2.0]);
        assert!(!Row::new("nan", String::new(), 3, nan, 1.0).holds);
        assert_eq!(worst(&[vec![1.0], vec![2.0]], &[vec![1.0], vec![4.0]]), Some(0.5));
        assert_eq!(worst(&[vec![0.0]], &[vec![0.0]]), None);
        assert_eq!(mean_difference(&[1.0, 2.0], &[1.5, 2.5]), Some(0.5));
    }
}
