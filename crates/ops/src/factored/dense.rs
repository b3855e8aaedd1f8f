//! Dense layers over a block of samples that stays in the cache.
//!
//! A matrix has a row per sample, padded to whole vectors; the padding of a layer's output is 0.

use super::layout::Layer;
use crate::host::matmul::{COLUMNS, InitialSum, Matrix, product};

pub(super) const BLOCK: usize = 240;

/// Returns the length of a padded row of `columns` elements.
pub(super) const fn padded(columns: usize) -> usize {
    columns.next_multiple_of(COLUMNS)
}

/// Packs a layer's weights `[inputs, padded outputs]`, with its biases as the last row.
pub(super) fn packed(parameters: &[f32], layer: &Layer) -> Vec<f32> {
    let width = padded(layer.outputs);
    let mut packed = vec![0.0; (layer.inputs + 1) * width];
    for output in 0..layer.outputs {
        for input in 0..layer.inputs {
            packed[input * width + output] = parameters[layer.weight + output * layer.inputs + input];
        }
        packed[layer.inputs * width + output] = parameters[layer.bias() + output];
    }
    packed
}

/// Adds values in the order of [`packed`] to `parameters`, which are in the order of [`Layer`].
pub(super) fn unpacked(packed: &[f32], layer: &Layer, parameters: &mut [f32]) {
    let width = padded(layer.outputs);
    for output in 0..layer.outputs {
        for input in 0..layer.inputs {
            parameters[layer.weight + output * layer.inputs + input] += packed[input * width + output];
        }
        parameters[layer.bias() + output] += packed[layer.inputs * width + output];
    }
}

/// Packs a layer's weights `[outputs, padded inputs]` without the first `skipped` inputs.
pub(super) fn rows(parameters: &[f32], layer: &Layer, skipped: usize) -> Vec<f32> {
    let width = padded(layer.inputs - skipped);
    let mut rows = vec![0.0; layer.outputs * width];
    for (row, weights) in rows.chunks_exact_mut(width.max(1)).zip(parameters[layer.weight..].chunks_exact(layer.inputs))
    {
        row[..layer.inputs - skipped].copy_from_slice(&weights[skipped..]);
    }
    rows
}

/// Computes y = w x + bias, with a ReLU if `relu`, of the first `samples` rows.
#[inline(always)]
pub(super) fn forward(packed: &[f32], layer: &Layer, x: &[f32], y: &mut [f32], samples: usize, relu: bool) {
    let (width, x_width) = (padded(layer.outputs), padded(layer.inputs));
    let bias = InitialSum::Bias(&packed[layer.inputs * width..]);
    let (y_at, x_at) = (Matrix::rows(0, width), Matrix::rows(0, x_width));
    product([samples, width, layer.inputs], bias, (y, y_at), (x, x_at), (packed, y_at));
    if relu {
        for y in &mut y[..samples * width] {
            // Not `f32::max`, which would turn NaN into 0.
            *y = if *y < 0.0 { 0.0 } else { *y };
        }
    }
}

/// Adds the gradient of a layer's weights and biases to `dpacked`, given the gradient `dy` of its outputs before activation.
#[inline(always)]
pub(super) fn weight_gradient(dpacked: &mut [f32], layer: &Layer, dy: &[f32], x: &[f32], samples: usize) {
    let width = padded(layer.outputs);
    let (dy_at, x_at) = (Matrix::rows(0, width), Matrix::rows(0, padded(layer.inputs)).transposed());
    product([layer.inputs, width, samples], InitialSum::Previous, (dpacked, dy_at), (x, x_at), (dy, dy_at));
    let bias = &mut dpacked[layer.inputs * width..];
    for dy in dy[..samples * width].chunks_exact(width) {
        for (db, dy) in bias.iter_mut().zip(dy) {
            *db += dy;
        }
    }
}

/// Computes dx = wᵀ dy for the inputs that `rows` holds. Only the first `used` outputs have a gradient.
pub(super) fn input_gradient(rows: &[f32], layer: &Layer, used: usize, dy: &[f32], dx: &mut [f32], samples: usize) {
    let width = rows.len() / layer.outputs;
    let (dy_at, dx_at) = (Matrix::rows(0, padded(layer.outputs)), Matrix::rows(0, width));
    product([samples, width, used], InitialSum::Zero, (dx, dx_at), (dy, dy_at), (rows, dx_at));
}
