//! Compositing with all that it returns: weights, colour, depth, opacity, Σα and entropy, with gradients.

use burn::tensor::{Device, Tensor, TensorData};
use fastrand::Rng;
use infonerf_ops::{Composite, Segments, composite, reference, to_host};
use rayon::prelude::*;

use super::errors::Errors;
use super::rays::Family;

/// Columns of the result.
pub(super) const QUANTITIES: [&str; 7] =
    ["weights", "colour", "depth", "opacity", "alpha sum", "entropy", "entropy, eps 1e-10"];
/// The exact entropy and the released code's.
const EPSILONS: [f32; 2] = [0.0, 1e-10];
/// Colour and distance of each sample.
const CHANNELS: usize = 4;
/// Samples of a batch, about.
const BATCH: usize = 300_000;

/// Rays with colours, distances, and the gradient of something with respect to their colour.
struct Batch {
    segments: Segments,
    tau: Vec<f32>,
    values: Vec<f32>,
    upstream: Vec<f32>,
}

impl Batch {
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

/// What a device says: values a ray, and a gradient of each with respect to every τ.
struct Answer {
    weights: Vec<f32>,
    color: Vec<f32>,
    columns: [Vec<f32>; 5],
    gradients: [Vec<f32>; 6],
}

/// Errors of each of [`QUANTITIES`] over `count` rays of a family.
pub(super) fn measure(family: &Family, count: usize, device: &Device, rng: &mut Rng) -> Vec<Errors> {
    let mut errors = vec![Errors::default(); QUANTITIES.len()];
    let mut left = ((count as f64 * family.share) as usize).max(1);
    while left > 0 {
        let (mut rows, mut samples) = (Vec::new(), 0);
        while left > 0 && samples < BATCH {
            let row = (family.draw)(rng);
            samples += row.len();
            rows.push(row);
            left -= 1;
        }
        let batch = Batch::new(&rows, rng);
        let answer = ask(&batch, &device.clone().autodiff());
        for (sum, errors) in errors.iter_mut().zip(compare(&batch, &answer)) {
            sum.merge(&errors);
        }
    }
    errors
}

fn ask(batch: &Batch, device: &Device) -> Answer {
    let samples = batch.tau.len();
    let tau = Tensor::<1>::from_data(TensorData::new(batch.tau.clone(), [samples]), device).require_grad();
    let values = TensorData::new(batch.values.clone(), [samples, CHANNELS]);
    let values = Tensor::<2>::from_data(values, device).require_grad();
    let upstream = TensorData::new(batch.upstream.clone(), [batch.segments.rays(), 3]);
    let upstream = Tensor::<2>::from_data(upstream, device);
    // One graph a backward pass: Burn consumes it.
    let run = |epsilon| composite(tau.clone(), values.clone(), &batch.segments, Some(epsilon));
    let grads = |objective: &dyn Fn(Composite) -> Tensor<1>, epsilon| {
        let grads = objective(run(epsilon)).backward();
        let of = |tensor: Option<Tensor<1>>| tensor.map(to_host).unwrap_or_default();
        (of(tau.grad(&grads)), values.grad(&grads).map(to_host).unwrap_or_default())
    };
    let [exact, softened] = EPSILONS;
    let distance = |out: Composite| out.values.narrow(1, 3, 1).sum();
    let (depth_gradient, dvalues) = grads(&distance, exact);
    let out = run(exact);
    Answer {
        // The gradient of Σ w t with respect to t is w.
        weights: dvalues.chunks_exact(CHANNELS).map(|row| row[3]).collect(),
        color: to_host(out.values.clone().narrow(1, 0, 3).detach()),
        columns: [
            to_host(out.values.narrow(1, 3, 1).detach()),
            to_host(out.acc.detach()),
            to_host(out.alpha_sum.detach()),
            to_host(out.entropy.detach()),
            to_host(run(softened).entropy.detach()),
        ],
        gradients: [
            grads(&|out| (out.values.narrow(1, 0, 3) * upstream.clone()).sum(), exact).0,
            depth_gradient,
            grads(&|out| out.acc.sum(), exact).0,
            grads(&|out| out.alpha_sum.sum(), exact).0,
            grads(&|out| out.entropy.sum(), exact).0,
            grads(&|out| out.entropy.sum(), softened).0,
        ],
    }
}

fn compare(batch: &Batch, answer: &Answer) -> Vec<Errors> {
    let none = || vec![Errors::default(); QUANTITIES.len()];
    let add = |mut errors: Vec<Errors>, ray: usize| {
        let range = batch.segments.range(ray);
        let row: Vec<f64> = batch.tau[range.clone()].iter().copied().map(f64::from).collect();
        let value = |i: usize, channel: usize| f64::from(batch.values[i * CHANNELS + channel]);
        let along = |channel| range.clone().map(|i| value(i, channel)).collect::<Vec<f64>>();
        let w = reference::weights(&row);
        let integral = |channel: usize| w.iter().zip(along(channel)).map(|(w, v)| w * v).sum::<f64>();
        for (&got, &want) in answer.weights[range.clone()].iter().zip(&w) {
            errors[0].value(got, want);
        }
        for channel in 0..3 {
            errors[1].value(answer.color[3 * ray + channel], integral(channel));
        }
        let [exact, softened] = EPSILONS.map(f64::from);
        let wants = [
            integral(3),
            reference::opacity(&row),
            reference::alpha_sum(&row),
            reference::entropy(&row, exact),
            reference::entropy(&row, softened),
        ];
        for ((errors, column), want) in errors[2..].iter_mut().zip(&answer.columns).zip(wants) {
            errors.value(column[ray], want);
        }
        let upstream = |channel: usize| f64::from(batch.upstream[3 * ray + channel]);
        let worth = range.clone().map(|i| (0..3).map(|channel| upstream(channel) * value(i, channel)).sum());
        let wants = [
            reference::weights_vjp(&row, &worth.collect::<Vec<f64>>()),
            reference::weights_vjp(&row, &along(3)),
            reference::weights_vjp(&row, &vec![1.0; row.len()]),
            row.iter().map(|tau| (-tau).exp()).collect(),
            reference::entropy_gradient(&row, exact),
            reference::entropy_gradient(&row, softened),
        ];
        for (i, (gradient, want)) in answer.gradients.iter().zip(wants).enumerate() {
            // The exact entropy has an infinite slope where a sample is empty.
            let undefined = |sample: usize| i == 4 && row[sample] < f64::from(f32::MIN_POSITIVE);
            errors[1 + i].gradient(&gradient[range.clone()], &want, undefined);
        }
        errors
    };
    let merge = |mut a: Vec<Errors>, b: Vec<Errors>| {
        a.iter_mut().zip(&b).for_each(|(a, b)| a.merge(b));
        a
    };
    (0..batch.segments.rays()).into_par_iter().fold(none, add).reduce(none, merge)
}
