//! Errors of compositing (weights, colour, depth, opacity), Σα and entropy, with gradients.

use burn::tensor::{Device, Tensor};
use fastrand::Rng;
use infonerf_ops::{Composite, Segments, composite, ray_entropy, to_host, upload_rows};
use rayon::prelude::*;

use super::errors::Errors;
use super::rays::DrawRay;
use crate::values::{gradient_of, leaf, wide};

pub(super) const QUANTITIES: [&str; 7] =
    ["weights", "colour", "depth", "opacity", "alpha sum", "entropy", "entropy, eps 1e-10"];
/// ε of the entropies among the quantities: exact, and that of the released code.
const EPSILONS: [f32; 2] = [0.0, 1e-10];
/// Number of values of a sample: colour and distance.
const CHANNELS: usize = 4;
/// Approximate number of samples in a batch.
const BATCH: usize = 300_000;

/// Rays with colours, distances, and the gradient of a loss with respect to their colour.
struct StressBatch {
    segments: Segments,
    tau: Vec<f32>,
    values: Vec<f32>,
    upstream: Vec<f32>,
}

impl StressBatch {
    fn new(rows: &[Vec<f32>], rng: &mut Rng) -> Self {
        let tau = rows.concat();
        let sample = |rng: &mut Rng| [rng.f32(), rng.f32(), rng.f32(), 2.0 + 4.0 * rng.f32()];
        Self {
            segments: Segments::from_counts(rows.iter().map(Vec::len)),
            values: tau.iter().flat_map(|_| sample(rng)).collect(),
            upstream: (0..3 * rows.len()).map(|_| 2.0 * rng.f32() - 1.0).collect(),
            tau,
        }
    }
}

/// Results of a device: values of each ray, and their gradients with respect to every τ.
struct DeviceResults {
    weights: Vec<f32>,
    color: Vec<f32>,
    /// Values per ray of depth, opacity, Σα, then the entropies.
    columns: Vec<Vec<f32>>,
    /// Gradients with respect to τ of colour, depth, opacity, Σα, then the entropies.
    gradients: Vec<Vec<f32>>,
}

/// Measures the errors of each of [`QUANTITIES`] over `left` rays of a family.
pub(super) fn measure(draw: DrawRay, mut left: usize, device: &Device, rng: &mut Rng) -> Vec<Errors> {
    let mut errors = none();
    while left > 0 {
        let (mut rows, mut samples) = (Vec::new(), 0);
        while left > 0 && samples < BATCH {
            let row = draw(rng);
            samples += row.len();
            rows.push(row);
            left -= 1;
        }
        let batch = StressBatch::new(&rows, rng);
        errors = merged(errors, compare(&batch, &compute(&batch, device)));
    }
    errors
}

fn none() -> Vec<Errors> {
    vec![Errors::default(); QUANTITIES.len()]
}

fn merged(a: Vec<Errors>, b: Vec<Errors>) -> Vec<Errors> {
    a.into_iter().zip(b).map(|(a, b)| a.merged(b)).collect()
}

fn compute(batch: &StressBatch, device: &Device) -> DeviceResults {
    let tau = leaf(&batch.tau, device);
    let values = upload_rows(&batch.values, CHANNELS, &device.clone().autodiff()).require_grad();
    let upstream = upload_rows(&batch.upstream, 3, &device.clone().autodiff());
    // Each backward pass needs a graph of its own, since Burn consumes the graph.
    let run = || composite(tau.clone(), values.clone(), &batch.segments);
    let entropy = |epsilon| ray_entropy(tau.clone(), &batch.segments, epsilon);
    let gradients = |objective: Tensor<1>| {
        let grads = objective.backward();
        (gradient_of(&tau, &grads), gradient_of(&values, &grads))
    };
    let (depth_gradient, dvalues) = gradients(run().values.narrow(1, 3, 1).sum());
    let Composite { values: integrals, acc } = run();
    let columns = [integrals.clone().narrow(1, 3, 1).flatten(0, 1), acc, entropy(EPSILONS[0]).alpha_sum];
    let bits = EPSILONS.map(|epsilon| entropy(epsilon).bits);
    let mut gradients_of_tau = vec![
        gradients((run().values.narrow(1, 0, 3) * upstream).sum()).0,
        depth_gradient,
        gradients(run().acc.sum()).0,
        gradients(entropy(EPSILONS[0]).alpha_sum.sum()).0,
    ];
    gradients_of_tau.extend(EPSILONS.map(|epsilon| gradients(entropy(epsilon).bits.sum()).0));
    DeviceResults {
        // The gradient of Σ w t with respect to t is w.
        weights: dvalues.chunks_exact(CHANNELS).map(|row| row[3]).collect(),
        color: to_host(integrals.narrow(1, 0, 3).detach()),
        columns: columns.into_iter().chain(bits).map(|column| to_host(column.detach())).collect(),
        gradients: gradients_of_tau,
    }
}

fn compare(batch: &StressBatch, answer: &DeviceResults) -> Vec<Errors> {
    let add = |mut errors: Vec<Errors>, ray: usize| {
        let range = batch.segments.range(ray);
        let row = wide(&batch.tau[range.clone()]);
        let value = |i: usize, channel: usize| f64::from(batch.values[i * CHANNELS + channel]);
        let along = |channel| range.clone().map(|i| value(i, channel)).collect::<Vec<f64>>();
        let w = infonerf_oracle::weights(&row);
        let integral = |channel: usize| w.iter().zip(along(channel)).map(|(w, v)| w * v).sum::<f64>();
        for (&got, &want) in answer.weights[range.clone()].iter().zip(&w) {
            errors[0].value(got, want);
        }
        for channel in 0..3 {
            errors[1].value(answer.color[3 * ray + channel], integral(channel));
        }
        let [exact, released] = EPSILONS.map(|epsilon| infonerf_oracle::entropy(&row, f64::from(epsilon)));
        let wants = [integral(3), infonerf_oracle::opacity(&row), infonerf_oracle::alpha_sum(&row), exact, released];
        for ((errors, column), want) in errors[2..].iter_mut().zip(&answer.columns).zip(wants) {
            errors.value(column[ray], want);
        }
        let upstream = |channel: usize| f64::from(batch.upstream[3 * ray + channel]);
        let worth = range.clone().map(|i| (0..3).map(|channel| upstream(channel) * value(i, channel)).sum());
        let integrals = [
            infonerf_oracle::weights_vjp(&row, &worth.collect::<Vec<f64>>()),
            infonerf_oracle::weights_vjp(&row, &along(3)),
            infonerf_oracle::weights_vjp(&row, &vec![1.0; row.len()]),
            row.iter().map(|tau| (-tau).exp()).collect(),
        ];
        for (i, want) in integrals.iter().enumerate() {
            errors[1 + i].gradient(&answer.gradients[i][range.clone()], want, |_| false);
        }
        for (i, epsilon) in EPSILONS.into_iter().enumerate() {
            let want = infonerf_oracle::entropy_gradient(&row, f64::from(epsilon));
            // The exact entropy has an infinite derivative at an empty sample.
            let undefined = |sample: usize| epsilon == 0.0 && row[sample] < f64::from(f32::MIN_POSITIVE);
            errors[5 + i].gradient(&answer.gradients[4 + i][range.clone()], &want, undefined);
        }
        errors
    };
    (0..batch.segments.rays()).into_par_iter().fold(none, add).reduce(none, merged)
}
