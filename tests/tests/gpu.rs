//! The GPU against flex: operations, gradients of every kind of field, and whole training steps.
#![cfg(feature = "gpu")]

#[path = "../../crates/train/tests/common/mod.rs"]
mod common;

use std::collections::BTreeMap;
use std::sync::Arc;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData};
use common::{configs, steps, trainer};
use infonerf_ops::factored::{Layout, Query, factored_field, plane_variation};
use infonerf_ops::{
    RayDistribution, Segments, composite, frequency_encode, integrated_encode, ray_divergence, ray_entropy, to_host,
};
use infonerf_tests::{gpu, hashed};
use infonerf_train::{Config, Event, Trainer, evaluate_view};

/// Values and gradients of one operation, over the largest of their array.
const OPERATION: f32 = 1e-4;
/// Sines and cosines of phases up to 3·2¹⁶.
const ENCODING: f32 = 1e-6;
/// Gradients of a whole step, likewise: sums over thousands of samples in another order.
const GRADIENT: f32 = 2e-3;
/// Losses of later steps: Adam divides by the size of gradients, which lets small differences grow.
const LOSS: f32 = 1e-2;
/// Colours of a picture after those steps, on average.
const COLOR: f32 = 5e-3;
const STEPS: usize = 20;

fn close(got: &[f32], want: &[f32], tolerance: f32, what: &str) {
    assert_eq!(got.len(), want.len(), "{what}");
    let largest = want.iter().fold(f32::MIN_POSITIVE, |largest, x| largest.max(x.abs()));
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        assert!((got - want).abs() <= tolerance * largest, "{what}, number {i}: {got} for {want}, of up to {largest}");
    }
}

/// Array `index` of `count` numbers in [`low`, `high`).
fn numbers(index: usize, count: usize, low: f32, high: f32) -> Vec<f32> {
    (0..count).map(|i| low + (high - low) * (0.5 + 0.5 * hashed(index, i) as f32)).collect()
}

fn leaf(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), &device.clone().autodiff()).require_grad()
}

/// The output, and the gradient of Σ wᵢ outᵢ for some w with respect to each input.
fn pulled<const D: usize>(out: Tensor<D>, inputs: &[&Tensor<1>]) -> Vec<Vec<f32>> {
    let out = out.flatten::<1>(0, D - 1);
    let count = out.dims()[0];
    let pull = TensorData::new(numbers(99, count, -1.0, 1.0), [count]);
    let grads = (out.clone() * Tensor::from_data(pull, &out.device())).sum().backward();
    let gradients = inputs.iter().map(|input| to_host(input.grad(&grads).expect("the output depends on it")));
    std::iter::once(to_host(out.detach())).chain(gradients).collect()
}

fn same(what: &str, on: impl Fn(&Device) -> Vec<Vec<f32>>) {
    for (place, (got, want)) in on(&gpu()).iter().zip(&on(&Device::flex())).enumerate() {
        close(got, want, OPERATION, &format!("{what}, {}", ["value", "first gradient", "second gradient"][place]));
    }
}

/// Rays of all lengths, some of them empty, with depths from almost nothing to opaque.
fn rays() -> (Segments, Vec<f32>, Vec<f32>) {
    let segments = Segments::from_counts(numbers(1, 300, 0.0, 40.0).into_iter().map(|length| length as usize));
    let depths = |index| numbers(index, segments.samples(), -14.0, 3.0).into_iter().map(f32::exp).collect();
    (segments.clone(), depths(2), depths(3))
}

#[test]
fn compositing() {
    let (segments, tau, _) = rays();
    let values = numbers(4, 4 * tau.len(), 0.0, 1.0);
    same("compositing", |device| {
        let (tau, values) = (leaf(&tau, device), leaf(&values, device));
        let out = composite(tau.clone(), values.clone().reshape([-1, 4]), &segments);
        let out = Tensor::cat(vec![out.values, out.acc.unsqueeze_dim::<2>(1)], 1);
        pulled(out, &[&tau, &values])
    });
}

#[test]
fn entropy() {
    let (segments, tau, _) = rays();
    for of in [RayDistribution::Alpha, RayDistribution::AlphaBackground, RayDistribution::Termination] {
        for epsilon in [0.0, 1e-10] {
            same(&format!("entropy of {of:?} with {epsilon:e}"), |device| {
                let tau = leaf(&tau, device);
                let out = ray_entropy(tau.clone(), &segments, of, epsilon);
                pulled(Tensor::cat(vec![out.bits, out.alpha_sum], 0), &[&tau])
            });
        }
    }
}

#[test]
fn divergence() {
    let (segments, tau, near) = rays();
    same("divergence", |device| {
        let (tau, near) = (leaf(&tau, device), leaf(&near, device));
        pulled(ray_divergence(tau.clone(), near.clone(), &segments, 1e-10), &[&tau, &near])
    });
}

#[test]
fn factored() {
    const SAMPLES: usize = 700;
    let layout = Arc::new(Layout::new(3, &[(8, 4), (16, 4)], (2, 32), true, (10.0, -5.0)));
    let tables = numbers(5, layout.table_len(), -0.5, 0.5);
    let weights = numbers(6, layout.weight_len(), -0.4, 0.4);
    let query = |color| Query {
        positions: numbers(7, 3 * SAMPLES, 0.0, 1.0).into(),
        directions: numbers(8, 3 * SAMPLES, -0.5, 0.5).into(),
        frequency_weights: vec![1.0, 1.0, 0.5],
        level_weights: vec![1.0, 0.5],
        color,
    };
    for color in [true, false] {
        same("factored field", |device| {
            let (tables, weights) = (leaf(&tables, device), leaf(&weights, device));
            pulled(factored_field(tables.clone(), weights.clone(), &layout, query(color)), &[&tables, &weights])
        });
    }
    same("plane variation", |device| {
        let tables = leaf(&tables, device);
        pulled(plane_variation(tables.clone(), &layout), &[&tables])
    });
}

#[test]
fn encodings() {
    let points = numbers(9, 3 * 500, -3.0, 3.0);
    let variances: Vec<f32> = numbers(10, points.len(), -25.0, 0.0).into_iter().map(f32::exp).collect();
    let window = [1.0, 1.0, 0.5, 0.0];
    for frequencies in [0, 1, 17] {
        let plain = |device: &Device| to_host(frequency_encode(&points, 3, frequencies, &window, device));
        close(&plain(&gpu()), &plain(&Device::flex()), ENCODING, "frequency encoding");
        let faded = |device: &Device| to_host(integrated_encode(&points, &variances, frequencies, &window, device));
        close(&faded(&gpu()), &faded(&Device::flex()), ENCODING, "integrated encoding");
    }
    // A thread for each of more points than one dimension of a grid has groups.
    let many = numbers(11, 3 * 1_500_000, -1.0, 1.0);
    let last = |device: &Device| to_host(frequency_encode(&many, 3, 1, &[], device).narrow(0, 1_499_000, 1000));
    close(&last(&gpu()), &last(&Device::flex()), ENCODING, "many points");
}

struct Weights(Vec<Vec<f32>>);

impl ModuleVisitor for Weights {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.push(to_host(param.val()));
    }
}

fn weights(trainer: &Trainer) -> Vec<Vec<f32>> {
    let mut weights = Weights(Vec::new());
    trainer.model().visit(&mut weights);
    weights.0
}

/// With ε = 1 Adam's first step is the rate times g/(1 + |g|): it shows the gradient of the whole loss.
fn gradients(config: &Config, device: &Device) -> Vec<Vec<f32>> {
    const RATE: f64 = 100.0;
    let mut config = config.clone();
    (config.train.lr, config.train.adam_epsilon, config.train.weight_averaging) = (RATE.into(), 1.0, 0.0);
    // Every term from the first step.
    config.loss.entropy.weight = 1e-3.into();
    let mut trainer = trainer(&config, 4, device);
    let before = weights(&trainer);
    steps(&mut trainer, 1);
    let moved = |(before, after): (&Vec<f32>, Vec<f32>)| {
        before.iter().zip(after).map(|(before, after)| (after - before) / RATE as f32).collect()
    };
    before.iter().zip(weights(&trainer)).map(moved).collect()
}

/// The field's kind, to name it.
fn kind(config: &Config) -> String {
    format!("{:?}", config.field).split('(').next().unwrap_or_default().to_owned()
}

#[test]
fn every_field_has_the_same_gradients() {
    for config in configs() {
        let (got, want) = (gradients(&config, &gpu()), gradients(&config, &Device::flex()));
        for (place, (got, want)) in got.iter().zip(&want).enumerate() {
            close(got, want, GRADIENT, &format!("{}, parameter {place}", kind(&config)));
        }
        assert!(want.iter().flatten().any(|g| *g != 0.0), "{}", kind(&config));
    }
}

#[test]
fn every_field_trains_the_same() {
    for mut config in configs() {
        config.train.iterations = STEPS;
        let name = kind(&config);
        let run = |device: &Device| {
            let mut trainer = trainer(&config, 5, device);
            let losses: Vec<BTreeMap<String, f32>> = steps(&mut trainer, STEPS)
                .into_iter()
                .filter_map(|event| match event {
                    Event::Step { loss, losses, .. } => {
                        Some(losses.into_iter().chain([("total".to_owned(), loss)]).collect())
                    }
                    _ => None,
                })
                .collect();
            let view = evaluate_view(trainer.renderer(), &[trainer.trained()], &trainer.scene().test[0]).unwrap();
            (losses, view.image.rgb)
        };
        let ((got, picture), (want, expected)) = (run(&gpu()), run(&Device::flex()));
        assert_eq!(want.len(), STEPS);
        for (step, (got, want)) in got.iter().zip(&want).enumerate() {
            assert!(got.keys().eq(want.keys()), "{name}, step {step}");
            for ((term, got), want) in got.iter().zip(want.values()) {
                let apart = (got - want).abs();
                assert!(apart <= LOSS * want.abs().max(0.01), "{name}, step {step}, {term}: {got} for {want}");
            }
        }
        let apart = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>() / 3.0;
        let apart = picture.iter().zip(&expected).map(apart).sum::<f32>() / picture.len() as f32;
        assert!(apart <= COLOR, "{name}: colours are {apart} apart");
    }
}
