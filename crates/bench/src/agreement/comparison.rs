//! Comparison of values and gradients on two devices.

use burn::tensor::{Device, Tensor, TensorData};
use fastrand::Rng;
use infonerf_ops::to_host;
use serde::Serialize;

use crate::values::{gradient_of, uniform};

pub(super) const SEED: u64 = 11;
/// Maximum error of a value or gradient, relative to the largest of its array.
const OPERATION: f64 = 1e-4;

#[derive(Serialize)]
pub(super) struct DeviceComparison {
    pub(super) what: String,
    pub(super) of: String,
    pub(super) numbers: usize,
    /// Error; `None` if values are missing, all 0 or not finite.
    pub(super) error: Option<f64>,
    pub(super) bound: f64,
    pub(super) holds: bool,
}

impl DeviceComparison {
    pub(super) fn new(what: &str, of: String, numbers: usize, error: Option<f64>, bound: f64) -> Self {
        let error = error.filter(|error| error.is_finite());
        Self { what: what.into(), of, numbers, error, bound, holds: error.is_some_and(|error| error <= bound) }
    }
}

/// Devices under comparison, and the results so far.
pub(super) struct DeviceComparisons<'a> {
    pub(super) tested: &'a Device,
    pub(super) reference: &'a Device,
    pub(super) rows: Vec<DeviceComparison>,
}

impl DeviceComparisons<'_> {
    /// Compares the arrays that `answer` returns for a device: values, then the gradient with respect to each input.
    pub(super) fn operation(&mut self, name: &str, answer: impl Fn(&Device) -> Vec<Vec<f32>>) {
        self.within(OPERATION, name, answer);
    }

    /// Compares as [`Self::operation`] does, with `bound` as the maximum error.
    pub(super) fn within(&mut self, bound: f64, name: &str, answer: impl Fn(&Device) -> Vec<Vec<f32>>) {
        let (got, want) = (answer(self.tested), answer(self.reference));
        self.rows.extend(want.iter().enumerate().map(|(place, want)| {
            let of = if place == 0 { "value".to_owned() } else { format!("gradient {place}") };
            let error = got.get(place).and_then(|got| largest_difference(got, want));
            DeviceComparison::new(name, of, want.len(), error, bound)
        }));
    }
}

/// Returns the output, and the gradient of Σ uᵢ outᵢ with respect to each input, with random u in [−1, 1).
pub(super) fn value_and_gradients<const D: usize>(out: Tensor<D>, inputs: &[&Tensor<1>]) -> Vec<Vec<f32>> {
    let out = out.flatten::<1>(0, D - 1);
    let count = out.dims()[0];
    let pull = TensorData::new(uniform(&mut Rng::with_seed(SEED), count, -1.0, 1.0), [count]);
    let grads = (out.clone() * Tensor::from_data(pull, &out.device())).sum().backward();
    std::iter::once(to_host(out.detach())).chain(inputs.iter().map(|input| gradient_of(input, &grads))).collect()
}

/// Returns the largest [`largest_difference`] of several arrays; `None` if they differ in number or length, or all is 0.
pub(super) fn worst(got: &[Vec<f32>], want: &[Vec<f32>]) -> Option<f64> {
    if got.len() != want.len() || want.iter().flatten().all(|want| *want == 0.0) {
        return None;
    }
    got.iter().zip(want).try_fold(0.0, |worst, (got, want)| Some(max_or_nan(worst, largest_difference(got, want)?)))
}

/// Returns the larger of two errors, or NaN if either is NaN, which `f64::max` would ignore.
pub(super) fn max_or_nan(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Computes max |got − want| / max |want|; `None` if the arrays differ in length or are empty.
fn largest_difference(got: &[f32], want: &[f32]) -> Option<f64> {
    let largest = want.iter().map(|want| want.abs()).fold(f32::MIN_POSITIVE, f32::max);
    let differences = got.iter().zip(want).map(|(got, want)| f64::from(got - want).abs());
    (got.len() == want.len() && !want.is_empty()).then(|| differences.fold(0.0, max_or_nan) / f64::from(largest))
}

/// Computes mean |got − want|; `None` if the arrays differ in length or are empty.
pub(super) fn mean_difference(got: &[f32], want: &[f32]) -> Option<f64> {
    let sum: f64 = got.iter().zip(want).map(|(got, want)| f64::from(got - want).abs()).sum();
    (got.len() == want.len() && !want.is_empty()).then(|| sum / want.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_relative_to_the_largest_and_keep_nan() {
        assert_eq!(largest_difference(&[1.0, 3.0], &[2.0, 4.0]), Some(0.25));
        assert_eq!(largest_difference(&[1.0], &[1.0, 2.0]), None);
        assert_eq!(largest_difference(&[], &[]), None);
        let nan = largest_difference(&[f32::NAN, 1.0, 2.0], &[1.0, 1.0, 2.0]);
        assert!(!DeviceComparison::new("nan", String::new(), 3, nan, 1.0).holds);
        assert_eq!(worst(&[vec![1.0], vec![2.0]], &[vec![1.0], vec![4.0]]), Some(0.5));
        assert_eq!(worst(&[vec![0.0]], &[vec![0.0]]), None);
        assert_eq!(mean_difference(&[1.0, 2.0], &[1.5, 2.5]), Some(0.5));
    }
}
