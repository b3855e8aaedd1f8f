//! Errors of encodings, the factored field, the variation of its planes, and the photometric loss.

use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use fastrand::Rng;
use infonerf_loss::{Norm, photometric_loss};
use infonerf_ops::factored::{FactoredLayout, Query};
use infonerf_ops::frequency::encoded_width;
use infonerf_ops::{
    RayGaussians, factored_field, frequency_encode, frustum_gaussians, integrated_encode, plane_variation, to_host,
    upload_rows,
};

use super::errors::Errors;
use super::geometry::on_sphere;
use super::rays::log_uniform;
use crate::values::{gradient_of, joined, leaf, wide};

type Draw = fn(&mut Rng) -> f32;

/// Families of coordinates of points, from the origin to far away.
pub(super) const COORDINATES: [(&str, Draw); 5] = [
    ("a scene of 4 units", |rng| 8.0 * (rng.f32() - 0.5)),
    ("a scene of 1e-3 units", |rng| 2e-3 * (rng.f32() - 0.5)),
    ("a scene of 1e3 units", |rng| 2e3 * (rng.f32() - 0.5)),
    ("subnormal", |rng| log_uniform(rng, -44.9, -38.0)),
    ("as far as f32 goes", |rng| log_uniform(rng, 6.0, 38.5).min(f32::MAX) * if rng.bool() { 1.0 } else { -1.0 }),
];

/// Number of frequencies of the encoding, twice NeRF's 10.
const FREQUENCIES: usize = 20;

pub(super) fn encoding(draw: Draw, count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let points = drawn(rng, count, draw);
    let encoded = to_host(frequency_encode(upload_rows(&points, 1, device), FREQUENCIES, &[]));
    let mut errors = Errors::default();
    for (row, &x) in encoded.chunks_exact(encoded_width(1, FREQUENCIES)).zip(&points) {
        errors.value(row[0], f64::from(x));
        let waves = infonerf_oracle::waves(f64::from(x), 0.0, &[1.0; FREQUENCIES]);
        for (&got, &want) in row[1..].iter().zip(waves.as_flattened()) {
            errors.value(got, want);
        }
    }
    errors
}

/// Measures the integrated encoding of `count` Gaussians around drawn coordinates, from nearly points to a unit wide.
pub(super) fn integrated(draw: Draw, count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let (means, variances) = (drawn(rng, 3 * count, draw), drawn(rng, 3 * count, |rng| log_uniform(rng, -12.0, 0.0)));
    let [mean, variance] = [&means, &variances].map(|rows| upload_rows(rows, 3, device));
    let encoded = to_host(integrated_encode(mean, variance, FREQUENCIES, &[]));
    let mut errors = Errors::default();
    for (sample, row) in encoded.chunks_exact(6 * FREQUENCIES).enumerate() {
        for axis in 0..3 {
            let [mean, variance] = [&means, &variances].map(|values| f64::from(values[3 * sample + axis]));
            let waves = infonerf_oracle::waves(mean, variance, &[1.0; FREQUENCIES]);
            for (block, [sine, cosine]) in row.chunks_exact(6).zip(waves) {
                errors.value(block[axis], sine);
                errors.value(block[3 + axis], cosine);
            }
        }
    }
    errors
}

/// Measures the mean and variances of conical frustums, from the apex to far away.
pub(super) fn frustums(count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let mut errors = Errors::default();
    let t = drawn(rng, count, |rng| log_uniform(rng, -6.0, 6.0));
    // Frustums do not reach behind the apex.
    let delta: Vec<f32> = t.iter().map(|t| t * log_uniform(rng, -6.0, 0.3).min(2.0)).collect();
    let radii = drawn(rng, count, |rng| log_uniform(rng, -5.0, -1.0));
    let [a, b, c] = [&t, &delta, &radii].map(|numbers| Tensor::from_floats(numbers.as_slice(), device));
    let RayGaussians { mean, along, across } = frustum_gaussians(a, b, c);
    let found = [mean, along, across].map(to_host);
    for i in 0..count {
        let (t, half) = (f64::from(t[i]), 0.5 * f64::from(delta[i]));
        let want = infonerf_oracle::frustum_moments(t - half, t + half, f64::from(radii[i]));
        for (got, want) in found.iter().zip(want) {
            errors.value(got[i], want);
        }
    }
    errors
}

/// Contents of a field: values of its tables and of its MLP, and the bias of its density.
type FieldContents = (Draw, Draw, f32);

pub(super) const CONTENTS: [(&str, FieldContents); 6] = [
    ("as trained", (signed, signed, -5.0)),
    ("empty", (signed, signed, -40.0)),
    ("opaque", (signed, signed, 40.0)),
    ("all zero", (|_| 0.0, |_| 0.0, -5.0)),
    ("tables 1e-30 to 1e-6", (|rng| log_uniform(rng, -30.0, -6.0), signed, -5.0)),
    ("tables 1e3", (|rng| 1e3 * signed(rng), signed, -5.0)),
];

fn signed(rng: &mut Rng) -> f32 {
    rng.f32() - 0.5
}

const SAMPLES: usize = 256;

fn layout(bias: f32) -> Arc<FactoredLayout> {
    Arc::new(FactoredLayout::new(3, &[(4, 4), (8, 4), (16, 4)], (2, 16), true, (10.0, bias)))
}

fn drawn(rng: &mut Rng, count: usize, draw: Draw) -> Vec<f32> {
    (0..count).map(|_| draw(rng)).collect()
}

/// Measures density and colour at `count` points, some on the border of the box.
pub(super) fn field((tables, weights, bias): FieldContents, count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let mut errors = Errors::default();
    let device = device.clone().autodiff();
    let layout = layout(bias);
    for _ in 0..count.div_ceil(SAMPLES) {
        let tables = drawn(rng, layout.table_len(), tables);
        let weights = drawn(rng, layout.weight_len(), weights);
        let coordinate = |rng: &mut Rng| match rng.u8(0..8) {
            0 => 0.0,
            1 => 1.0,
            2 => log_uniform(rng, -44.0, -3.0),
            _ => rng.f32(),
        };
        let positions: Vec<f32> = (0..3 * SAMPLES).map(|_| coordinate(rng)).collect();
        let directions: Vec<f32> = (0..SAMPLES).flat_map(|_| on_sphere(rng, 1.0)).collect();
        let query = Query {
            positions: upload_rows(&positions, 3, &device),
            directions: Some(upload_rows(&directions, 3, &device)),
            frequency_weights: vec![1.0; layout.frequencies],
            level_weights: vec![1.0; layout.levels.len()],
            color: true,
            negligible: 0.0,
        };
        let (t, w) = (leaf(&tables, &device), leaf(&weights, &device));
        let out = joined(factored_field(t.clone(), w.clone(), &layout, query.clone()));
        let upstream = drawn(rng, 4 * SAMPLES, signed);
        let weigh = upload_rows(&upstream, 4, &device);
        let [tables, weights, positions] = [&tables, &weights, &positions].map(|values| wide(values));
        let wants = infonerf_oracle::factored::value(&tables, &weights, &positions, &layout, &query);
        for (&got, want) in to_host(out.clone().detach()).iter().zip(wants) {
            errors.value(got, want);
        }
        let grads = (out * weigh).sum().backward();
        let pull = wide(&upstream);
        let [dt, dw, _] = infonerf_oracle::factored::gradient(&tables, &weights, &positions, &layout, &query, &pull);
        for (parameter, want) in [(&t, dt), (&w, dw)] {
            errors.gradient(&gradient_of(parameter, &grads), &want, |_| false);
        }
    }
    errors
}

pub(super) const PLANES: [(&str, Draw); 4] = [
    ("as trained", signed),
    ("all equal", |_| 0.7),
    ("1e-9", |rng| 1e-9 * signed(rng)),
    ("1e9", |rng| 1e9 * signed(rng)),
];

pub(super) fn variation(contents: Draw, count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let mut errors = Errors::default();
    let layout = layout(0.0);
    for _ in 0..count.div_ceil(layout.table_len()) {
        let tables = drawn(rng, layout.table_len(), contents);
        let tensor = leaf(&tables, device);
        let sum = plane_variation(tensor.clone(), &layout);
        let (want, gradient) = infonerf_oracle::factored::variation(&wide(&tables), &layout);
        errors.value(to_host(sum.clone().detach())[0], want);
        errors.gradient(&gradient_of(&tensor, &sum.backward()), &gradient, |_| false);
    }
    errors
}

/// Draws a true colour, given the rendered one.
type Truth = fn(&mut Rng, f32) -> f32;

/// Relations of true to rendered colours.
pub(super) const COLORS: [(&str, Truth); 4] = [
    ("independent", |rng, _| rng.f32()),
    ("equal", |_, color| color),
    ("nearly equal", |rng, color| color * (1.0 + 1e-6 * signed(rng))),
    ("black and white", |_, color| if color < 0.5 { 1.0 } else { 0.0 }),
];

pub(super) fn photometric(truth: Truth, count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let color: Vec<f32> = (0..3 * count).map(|_| rng.f32()).collect();
    let target: Vec<f32> = color.iter().map(|&color| truth(rng, color)).collect();
    let device = device.clone().autodiff();
    let rendered = upload_rows(&color, 3, &device).require_grad();
    let loss = photometric_loss(rendered.clone(), upload_rows(&target, 3, &device), Norm::Mean);
    let difference = |(a, b): (&f32, &f32)| f64::from(*a) - f64::from(*b);
    let differences: Vec<f64> = color.iter().zip(&target).map(difference).collect();
    let share = 1.0 / (3 * count) as f64;
    let mut errors = Errors::default();
    errors.value(to_host(loss.clone().detach())[0], differences.iter().map(|d| d * d).sum::<f64>() * share);
    let want: Vec<f64> = differences.iter().map(|d| 2.0 * d * share).collect();
    errors.gradient(&gradient_of(&rendered, &loss.backward()), &want, |_| false);
    errors
}
