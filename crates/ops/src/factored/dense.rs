//! Dense layers over a block of samples that stays in cache.
//!
//! Everything is feature-major: row `f` of a block holds feature `f` of its [`BLOCK`] samples, so that interpolation fills
//! vectors with samples.

use super::layout::Layer;
use crate::matmul::{Matrix, Onto, product};

/// Samples in a block.
pub(super) const BLOCK: usize = 240;

/// Samples × features.
const SAMPLES: Matrix = Matrix { start: 0, row: 1, column: BLOCK };

/// Weights `[outputs, inputs]` without those of the first `skipped` inputs.
fn weights(layer: &Layer, skipped: usize) -> Matrix {
    Matrix { start: layer.weight + skipped, row: layer.inputs, column: 1 }
}

/// y = relu?(w x + bias) for the first `samples` samples, and as many outputs as `y` has rows.
#[inline(always)]
pub(super) fn forward(parameters: &[f32], layer: &Layer, x: &[f32], y: &mut [f32], samples: usize, relu: bool) {
    let sizes = [samples, y.len() / BLOCK, layer.inputs];
    product(sizes, Onto::Nothing, (y, SAMPLES), (x, SAMPLES), (parameters, weights(layer, 0).transposed()));
    for (row, bias) in y.chunks_exact_mut(BLOCK).zip(&parameters[layer.bias()..layer.end()]) {
        for y in &mut row[..samples] {
            let sum = *y + bias;
            // Not `f32::max`, which would turn NaN into 0.
            *y = if relu && sum < 0.0 { 0.0 } else { sum };
        }
    }
}

/// Adds the gradient of a layer's weights and biases to `dparameters`, given that of its outputs before activation.
#[inline(always)]
pub(super) fn weight_gradient(dparameters: &mut [f32], layer: &Layer, dy: &[f32], x: &[f32], samples: usize) {
    let sizes = [dy.len() / BLOCK, layer.inputs, samples];
    product(sizes, Onto::Sum, (dparameters, weights(layer, 0)), (dy, SAMPLES.transposed()), (x, SAMPLES));
    for (db, dy) in dparameters[layer.bias()..layer.end()].iter_mut().zip(dy.chunks_exact(BLOCK)) {
        *db += dy[..samples].iter().sum::<f32>();
    }
}

/// dx = wᵀ dy, without the first `skipped` inputs.
#[inline(always)]
pub(super) fn input_gradient(
    parameters: &[f32],
    layer: &Layer,
    skipped: usize,
    dy: &[f32],
    dx: &mut [f32],
    samples: usize,
) {
    let sizes = [samples, layer.inputs - skipped, dy.len() / BLOCK];
    product(sizes, Onto::Nothing, (dx, SAMPLES), (dy, SAMPLES), (parameters, weights(layer, skipped)));
}

/// dy ← dy where the ReLU's output y is positive, else 0.
#[inline(always)]
pub(super) fn relu_gradient(y: &[f32], dy: &mut [f32]) {
    for (dy, y) in dy.iter_mut().zip(y) {
        *dy = if *y <= 0.0 { 0.0 } else { *dy };
    }
}
