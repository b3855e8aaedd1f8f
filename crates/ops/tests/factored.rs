//! The factored field and the planes' variation: host kernel and plain tensors on two backends against the oracle in `f64`.

use std::sync::Arc;

use crate::common::{Draws, assert_close, joined, vector, wide};
use burn::tensor::{Device, Tensor};
use infonerf_ops::factored::{self, FactoredLayout, Query, factored_field, plane_variation};
use infonerf_ops::{to_host, upload_rows};
use infonerf_oracle::factored as oracle;

fn narrow(values: &[f64]) -> Vec<f32> {
    values.iter().map(|x| *x as f32).collect()
}

fn numbers(count: usize, seed: u64) -> Vec<f32> {
    Draws(seed).row(count)
}

struct FactoredCase {
    layout: Arc<FactoredLayout>,
    query: Query,
    /// Tables, weights and positions.
    inputs: [Vec<f32>; 3],
}

const RESULTS: [&str; 4] = ["value", "tables", "weights", "positions"];

/// Returns a field with one level at part of its weight, and samples of which some are outside the box.
fn case(samples: usize, color: bool, view_dependent: bool, channels: usize) -> FactoredCase {
    let levels = [(5, channels), (8, channels), (16, channels)];
    let layout = Arc::new(FactoredLayout::new(2, &levels, (2, 9), view_dependent, (10.0, -1.0)));
    let query = Query {
        positions: Tensor::zeros([0, 3], &Device::flex()),
        directions: (color && view_dependent).then(|| upload_rows(&numbers(3 * samples, 2), 3, &Device::flex())),
        frequency_weights: vec![1.0, 0.5],
        level_weights: vec![1.0, 0.4, 0.0],
        color,
        negligible: 0.0,
    };
    let tables = numbers(layout.table_len(), 3);
    let weights = numbers(layout.weight_len(), 4).into_iter().map(|w| 0.7 * w).collect();
    let positions = numbers(3 * samples, 1).into_iter().map(|x| 0.5 + 0.55 * x).collect();
    FactoredCase { layout, query, inputs: [tables, weights, positions] }
}

type FieldBody = fn(Tensor<1>, Tensor<1>, &Arc<FactoredLayout>, Query) -> (Tensor<1>, Option<Tensor<2>>);

type VariationBody = fn(Tensor<1>, &Arc<FactoredLayout>) -> Tensor<1>;

/// Returns the value, and the gradients of ⟨u, value⟩, each element of u times its `scale`.
fn run(case: &FactoredCase, device: &Device, body: FieldBody, scale: impl Fn(usize) -> f32) -> [Vec<f32>; 4] {
    let device = device.clone().autodiff();
    let [tables, weights, positions] = case.inputs.each_ref().map(|values| vector(values, &device).require_grad());
    let directions = case.query.directions.clone().map(|rows| upload_rows(&to_host(rows), 3, &device));
    let query = Query { positions: positions.clone().reshape([-1, 3]), directions, ..case.query.clone() };
    let out = joined(body(tables.clone(), weights.clone(), &case.layout, query));
    let [rows, columns] = out.dims();
    let u: Vec<f32> = numbers(rows * columns, 5).into_iter().enumerate().map(|(i, u)| scale(i) * u).collect();
    let grads = (out.clone() * upload_rows(&u, columns, &device)).sum().backward();
    let [dtables, dweights, dpositions] = [tables, weights, positions].map(|x| to_host(x.grad(&grads).unwrap()));
    [to_host(out), dtables, dweights, dpositions]
}

#[test]
fn values_and_gradients_match_the_oracle() {
    let cases = [(500, true, true, 4), (481, true, false, 2), (7, false, true, 8), (240, true, true, 16)];
    for (samples, color, view_dependent, channels) in cases {
        let case = case(samples, color, view_dependent, channels);
        let [tables, weights, positions] = &case.inputs.each_ref().map(|input| wide(input));
        let value = oracle::value(tables, weights, positions, &case.layout, &case.query);
        let u = wide(&numbers(value.len(), 5));
        let gradients = oracle::gradient(tables, weights, positions, &case.layout, &case.query, &u);
        let exact: Vec<Vec<f32>> = std::iter::once(value).chain(gradients).map(|values| narrow(&values)).collect();
        let bodies: [(Device, FieldBody); 3] =
            [(Device::flex(), factored_field), (Device::flex(), factored::plain), (Device::ndarray(), factored::plain)];
        for (index, (device, body)) in bodies.into_iter().enumerate() {
            for ((got, exact), what) in run(&case, &device, body, |_| 1.0).iter().zip(&exact).zip(RESULTS) {
                assert_close(got, exact, &format!("{samples} samples, {channels} channels, {what}, body {index}"));
            }
        }
    }
}

#[test]
fn negligible_gradients_alone_are_left_out() {
    // More than two blocks of samples. Two of three samples have gradients a millionth as large.
    let mut case = case(600, true, true, 4);
    let scale = |small: f32| move |i: usize| if (i / 4).is_multiple_of(3) { 1.0 } else { small };
    let device = Device::flex();
    let exact = run(&case, &device, factored_field, scale(1e-6));
    let without = run(&case, &device, factored_field, scale(0.0));
    case.query.negligible = 1e-4;
    let found = run(&case, &device, factored_field, scale(1e-6));
    assert_eq!(found, without);
    assert_ne!(found, exact);
    for (found, exact) in found.iter().zip(&exact) {
        let size = |numbers: &mut dyn Iterator<Item = f32>| numbers.map(|x| f64::from(x.abs())).sum::<f64>();
        let error = size(&mut found.iter().zip(exact).map(|(a, b)| a - b));
        assert!(error <= 1e-4 * size(&mut exact.iter().copied()), "{error}");
    }
}

#[test]
fn variation_matches_the_oracle() {
    let case = case(1, true, false, 4);
    let (exact, exact_gradient) = oracle::variation(&wide(&case.inputs[0]), &case.layout);
    let [kernel, plain]: [VariationBody; 2] = [plane_variation, factored::plain_variation];
    for (device, body) in [(Device::flex(), kernel), (Device::flex(), plain), (Device::ndarray(), plain)] {
        let tables = vector(&case.inputs[0], &device.autodiff()).require_grad();
        let sum = body(tables.clone(), &case.layout);
        let gradient = tables.grad(&sum.backward()).unwrap();
        assert_close(&to_host(sum), &[exact as f32], "variation");
        assert_close(&to_host(gradient), &narrow(&exact_gradient), "gradient of the variation");
    }
}
