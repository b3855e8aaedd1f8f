//! The factored field and the planes' variation: host kernel against plain tensors on two backends, and gradients against
//! finite differences.

#![allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::factored::{self, Layout, Query, factored_field, plane_variation};
use infonerf_ops::to_host;

/// Largest difference between two bodies in single precision, relative to the largest number of the result.
const AGREEMENT: f32 = 2e-5;
/// The same for a directional derivative against a central difference.
const DIFFERENCE: f64 = 2e-2;

/// Numbers in [−1, 1) that look random and are the same everywhere.
fn numbers(count: usize, salt: u32) -> Vec<f32> {
    let mix = |i: usize| {
        let mut x = (i as u32).wrapping_mul(0x9e37_79b9) ^ salt.wrapping_mul(0x85eb_ca6b);
        x ^= x >> 16;
        x = x.wrapping_mul(0x7feb_352d);
        x ^= x >> 15;
        x = x.wrapping_mul(0x846c_a68b);
        (x ^ (x >> 16)) as f32 / 2f32.powi(31) - 1.0
    };
    (0..count).map(mix).collect()
}

struct Case {
    layout: Arc<Layout>,
    query: Query,
    tables: Vec<f32>,
    weights: Vec<f32>,
}

/// More samples than a block, some of them outside the box; a level in the middle of fading in.
fn case(samples: usize, color: bool, view_dependent: bool, channels: usize) -> Case {
    let levels = [(5, channels), (8, channels), (16, channels)];
    let layout = Arc::new(Layout::new(2, &levels, (2, 9), view_dependent, (10.0, -1.0)));
    let query = Query {
        positions: numbers(3 * samples, 1).into_iter().map(|x| 0.5 + 0.55 * x).collect(),
        directions: if color && view_dependent { numbers(3 * samples, 2).into() } else { Arc::new([]) },
        frequency_weights: vec![1.0, 0.5],
        level_weights: vec![1.0, 0.4, 0.0],
        color,
    };
    let tables = numbers(layout.table_len(), 3);
    let weights = numbers(layout.weight_len(), 4).into_iter().map(|w| 0.7 * w).collect();
    Case { layout, query, tables, weights }
}

/// Value, and gradients of ⟨u, value⟩ for fixed u.
fn run(case: &Case, device: &Device, body: impl Fn(Tensor<1>, Tensor<1>) -> Tensor<2>) -> [Vec<f32>; 3] {
    let device = device.clone().autodiff();
    let parameter = |values: &[f32]| {
        Tensor::<1>::from_data(TensorData::new(values.to_vec(), [values.len()]), &device).require_grad()
    };
    let (tables, weights) = (parameter(&case.tables), parameter(&case.weights));
    let out = body(tables.clone(), weights.clone());
    let [rows, columns] = out.dims();
    let u = Tensor::<2>::from_data(TensorData::new(numbers(rows * columns, 5), [rows, columns]), &device);
    let grads = (out.clone() * u).sum().backward();
    [to_host(out), to_host(tables.grad(&grads).unwrap()), to_host(weights.grad(&grads).unwrap())]
}

fn assert_close(a: &[f32], b: &[f32], what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    let scale = b.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= AGREEMENT * scale, "{what}: {worst} of {scale}");
}

#[test]
fn bodies_agree_in_value_and_gradient() {
    for (samples, color, view_dependent, channels) in
        [(500, true, true, 4), (481, true, false, 2), (7, false, true, 8), (240, true, true, 16)]
    {
        let case = case(samples, color, view_dependent, channels);
        let host = run(&case, &Device::flex(), |t, w| factored_field(t, w, &case.layout, case.query.clone()));
        for device in [Device::flex(), Device::ndarray()] {
            let plain = run(&case, &device, |t, w| factored::plain(t, w, &case.layout, &case.query));
            for ((host, plain), what) in host.iter().zip(&plain).zip(["value", "table gradient", "weight gradient"]) {
                assert_close(host, plain, &format!("{samples} samples, {channels} channels, {what}, {device:?}"));
            }
        }
    }
}

#[test]
fn gradients_match_finite_differences() {
    let case = case(64, true, true, 4);
    let [_, dtables, dweights] =
        run(&case, &Device::flex(), |t, w| factored_field(t, w, &case.layout, case.query.clone()));
    let value = |tables: &[f32], weights: &[f32]| -> f64 {
        let moved = Case {
            tables: tables.to_vec(),
            weights: weights.to_vec(),
            layout: case.layout.clone(),
            query: case.query.clone(),
        };
        let [out, ..] = run(&moved, &Device::flex(), |t, w| factored_field(t, w, &case.layout, case.query.clone()));
        out.iter().zip(numbers(out.len(), 5)).map(|(y, u)| f64::from(*y) * f64::from(u)).sum()
    };
    let step = 1e-3;
    let moved = |from: &[f32], along: &[f32], by: f32| -> Vec<f32> {
        from.iter().zip(along).map(|(x, d)| x + by * d).collect()
    };
    for salt in 6..12 {
        let along = numbers(case.tables.len(), salt);
        let difference = (value(&moved(&case.tables, &along, step), &case.weights)
            - value(&moved(&case.tables, &along, -step), &case.weights))
            / f64::from(2.0 * step);
        let derivative: f64 = dtables.iter().zip(&along).map(|(g, d)| f64::from(*g) * f64::from(*d)).sum();
        assert!(
            (difference - derivative).abs() <= DIFFERENCE * derivative.abs().max(1.0),
            "tables: {difference} {derivative}"
        );

        let along = numbers(case.weights.len(), salt + 100);
        let difference = (value(&case.tables, &moved(&case.weights, &along, step))
            - value(&case.tables, &moved(&case.weights, &along, -step)))
            / f64::from(2.0 * step);
        let derivative: f64 = dweights.iter().zip(&along).map(|(g, d)| f64::from(*g) * f64::from(*d)).sum();
        assert!(
            (difference - derivative).abs() <= DIFFERENCE * derivative.abs().max(1.0),
            "weights: {difference} {derivative}"
        );
    }
}

#[test]
fn an_unused_level_gets_no_gradient() {
    let case = case(100, true, true, 4);
    let [_, dtables, _] = run(&case, &Device::flex(), |t, w| factored_field(t, w, &case.layout, case.query.clone()));
    let faded = &case.layout.levels[2];
    assert!(dtables[faded.offset..].iter().all(|g| *g == 0.0));
    assert!(dtables[..faded.offset].iter().any(|g| *g != 0.0));
}

#[test]
fn variation_agrees_and_ignores_the_lines() {
    let case = case(1, true, false, 4);
    let of = |device: Device, host: bool| -> (f32, Vec<f32>) {
        let device = device.autodiff();
        let tables = TensorData::new(case.tables.clone(), [case.tables.len()]);
        let tables = Tensor::<1>::from_data(tables, &device).require_grad();
        let sum = if host {
            plane_variation(tables.clone(), &case.layout)
        } else {
            factored::plain_variation(tables.clone(), &case.layout)
        };
        let grads = sum.backward();
        (sum.into_scalar(), to_host(tables.grad(&grads).unwrap()))
    };
    let (host, gradient) = of(Device::flex(), true);
    for device in [Device::flex(), Device::ndarray()] {
        let (plain, plain_gradient) = of(device, false);
        assert_close(&[host], &[plain], "variation");
        assert_close(&gradient, &plain_gradient, "gradient of the variation");
    }
    for level in &case.layout.levels {
        assert!(gradient[level.line(0)..level.offset + level.len()].iter().all(|g| *g == 0.0));
    }
}
