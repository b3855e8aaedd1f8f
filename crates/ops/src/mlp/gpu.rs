//! Dense layers on GPUs: a matrix product, then bias and activation in one launch.

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::{self, prelude::*};
use burn::tensor::FloatDType;
use burn_cubecl::CubeBackend;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::product::product;
use super::tall::{sum_rows, transposed_product};
use super::{Activation, Precision};
use crate::cube::rays::{alpha_of, ln_1p};
use crate::cube::{Operation, Pass, empty, empty_like, launch};

/// Number of threads that share the sums of a bias's gradient: what fills a large GPU.
const THREADS: usize = 1 << 18;
/// Max number of partial sums of an element of a bias's gradient.
const MAX_SUMS: usize = 1 << 12;

/// Layer `activation(x W + b)` of at least one row; its inputs are x, W and b.
#[derive(Debug)]
pub(super) struct GpuDense {
    pub(super) activation: Activation,
    pub(super) precision: Precision,
}

impl GpuDense {
    /// Rounds a factor to the precision of products.
    fn rounded(&self, factor: CubeTensor) -> CubeTensor {
        match self.precision {
            Precision::F32 => factor,
            Precision::Bf16 => CubeBackend::float_cast(factor, FloatDType::BF16),
        }
    }
}

impl Operation<CubeBackend> for GpuDense {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [x, weight, bias] = inputs else { unreachable!("a layer has an input, a matrix and a bias") };
        let out = product(self.rounded(x.clone()), self.rounded(weight.clone()));
        launch!(activate::launch, out.meta.num_elements(); &out, bias; self.activation);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [x, weight, bias] = pass.inputs else { unreachable!("a layer has an input, a matrix and a bias") };
        let out = pass.output;
        let [rows, columns] = out.meta.shape().dims();
        let sums = 1 << (THREADS / columns).clamp(1, rows.min(MAX_SUMS)).ilog2();
        let (dy, bias_sums) = (empty_like(out), empty(out, [sums, columns]));
        launch!(activate_backward::launch, sums * columns; out, pass.grad, &dy, &bias_sums; sums, self.activation);
        let dbias = reshape(sum_rows::<CubeBackend>(bias_sums), bias.meta.shape().clone());
        let dy = self.rounded(dy);
        let dweight = || transposed_product::<CubeBackend>(self.rounded(x.clone()), dy.clone(), product);
        let dweight = pass.wanted[1].then(dweight);
        let dx = pass.wanted[0].then(|| product(dy, CubeBackend::float_transpose(self.rounded(weight.clone()))));
        vec![dx, dweight, Some(dbias)]
    }
}

/// Adds the bias and applies the activation in place; NaN stays NaN.
#[cube(launch)]
fn activate(y: &mut Tensor<f32>, bias: &Tensor<f32>, #[comptime] activation: Activation) {
    if ABSOLUTE_POS >= y.len() {
        terminate!();
    }
    let x = y[ABSOLUTE_POS] + bias[ABSOLUTE_POS % y.shape(1)];
    y[ABSOLUTE_POS] = activated(x, activation);
}

/// Computes the gradient with respect to y + b, and its partial sums over every `sums`-th row.
#[cube(launch)]
fn activate_backward(
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    dy: &mut Tensor<f32>,
    partial: &mut Tensor<f32>,
    sums: usize,
    #[comptime] activation: Activation,
) {
    let columns = dy.shape(1);
    if ABSOLUTE_POS >= sums * columns {
        terminate!();
    }
    let mut sum = 0.0f32;
    let mut row = ABSOLUTE_POS / columns;
    while row < dy.shape(0) {
        let at = row * columns + ABSOLUTE_POS % columns;
        let d = before_activation(out[at], grad[at], activation);
        dy[at] = d;
        sum += d;
        row += sums;
    }
    partial[ABSOLUTE_POS] = sum;
}

/// Evaluates the activation at x; NaN stays NaN.
#[cube]
fn activated(x: f32, #[comptime] activation: Activation) -> f32 {
    let mut value = x + 0.0f32;
    match comptime!(activation) {
        Activation::None => {}
        Activation::Relu => {
            if x < 0.0f32 {
                value = 0.0f32;
            }
        }
        Activation::ShiftedSoftplus => {
            value = f32::max(x - 1.0f32, 0.0f32) + ln_1p(f32::exp(-f32::abs(x - 1.0f32)));
        }
        Activation::Sigmoid => value = 1.0f32 / (1.0f32 + f32::exp(-x)),
    }
    value
}

/// Computes the gradient with respect to x, given y = activation(x) and the gradient with respect to y.
#[cube]
fn before_activation(y: f32, grad: f32, #[comptime] activation: Activation) -> f32 {
    let mut d = grad + 0.0f32;
    match comptime!(activation) {
        Activation::None => {}
        Activation::Relu => {
            if y <= 0.0f32 {
                d = 0.0f32;
            }
        }
        Activation::ShiftedSoftplus => d *= alpha_of(y),
        Activation::Sigmoid => d *= y * (1.0f32 - y),
    }
    d
}
