//! A layer's bias and activation as one launch, and two on the way back.

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};
use burn_cubecl::CubeBackend;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::rays::alpha_of;
use super::tables::{sigmoid, softplus};
use super::{CubeKernel, Pass, apply, empty, empty_like};
use crate::mlp::Activation;

/// Threads that share the sums of a bias's gradient.
const THREADS: usize = 1 << 14;

/// The `function` of y + b, `[M, N]` and `[N]`.
pub(crate) fn activation(y: tensor::Tensor<2>, bias: tensor::Tensor<1>, function: Activation) -> tensor::Tensor<2> {
    apply(Activated(function), (y, bias))
}

#[derive(Debug)]
struct Activated(Activation);

impl CubeKernel for Activated {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [y, bias] = inputs else { unreachable!("a layer has a product and a bias") };
        // Nobody else has a product that has just been made.
        let out = if y.can_mut() { y.clone() } else { y.copy() };
        launch!(activate::launch, out.meta.num_elements(); &out, bias; self.0);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (out, bias) = (pass.output, &pass.inputs[1]);
        let [rows, columns] = out.meta.shape().dims();
        let sums = THREADS.div_ceil(columns).clamp(1, rows);
        let (dy, partial) = (empty_like(out), empty(out, [sums, columns]));
        launch!(activate_backward::launch, sums * columns; out, pass.grad, &dy, &partial; sums, self.0);
        let dbias = reshape(CubeBackend::float_sum_dim(partial, 0), Shape::new([bias.meta.num_elements()]));
        vec![Some(dy), Some(dbias)]
    }
}

/// In place; what is no number stays that.
#[cube(launch)]
fn activate(y: &mut Tensor<f32>, bias: &Tensor<f32>, #[comptime] function: Activation) {
    if ABSOLUTE_POS >= y.len() {
        terminate!();
    }
    let x = y[ABSOLUTE_POS] + bias[ABSOLUTE_POS % y.shape(1)];
    let mut value = x + 0.0f32;
    match comptime!(function) {
        Activation::None => {}
        Activation::Relu => {
            if x < 0.0f32 {
                value = 0.0f32;
            }
        }
        Activation::ShiftedSoftplus => value = softplus(x - 1.0f32),
        Activation::Sigmoid => value = sigmoid(x),
    }
    y[ABSOLUTE_POS] = value;
}

/// The gradient with respect to y + b, and its sums over every `sums`-th row.
#[cube(launch)]
fn activate_backward(
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    dy: &mut Tensor<f32>,
    partial: &mut Tensor<f32>,
    sums: usize,
    #[comptime] function: Activation,
) {
    let columns = dy.shape(1);
    if ABSOLUTE_POS >= sums * columns {
        terminate!();
    }
    let mut sum = 0.0f32;
    let mut row = ABSOLUTE_POS / columns;
    while row < dy.shape(0) {
        let at = row * columns + ABSOLUTE_POS % columns;
        let y = out[at];
        let mut slope = grad[at] + 0.0f32;
        match comptime!(function) {
            Activation::None => {}
            Activation::Relu => {
                if y <= 0.0f32 {
                    slope = 0.0f32;
                }
            }
            Activation::ShiftedSoftplus => slope *= alpha_of(y),
            Activation::Sigmoid => slope *= y * (1.0f32 - y),
        }
        dy[at] = slope;
        sum += slope;
        row += sums;
    }
    partial[ABSOLUTE_POS] = sum;
}
