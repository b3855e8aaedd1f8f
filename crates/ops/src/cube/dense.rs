//! A dense layer whose product's factors may be rounded: Burn's product, its bias and activation in one launch more, and four on
//! the way back.

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::{self, prelude::*, tf32};
use burn::tensor::{self, Device, FloatDType, Shape};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::activation::{activated, before_activation};
use super::{CubeKernel, Pass, apply, empty, empty_like, untracked};
use crate::mlp::{Activation, Precision};

/// Threads that share the sums of a bias's gradient.
const THREADS: usize = 1 << 14;

/// Whether `device` may round the factors of Burn's products of `f32` to TF32.
pub(crate) fn has_tf32(device: &Device) -> bool {
    let tensor = untracked(tensor::Tensor::<1>::empty([1], &device.clone().inner()));
    tensor.client.properties().supports_type(tf32::elem_type_native())
}

/// The `function` of x W + b of a layer `(W, b)`, `[M, k]·[k, n]` and `[n]`, M being a multiple of `parts`, of which there are as many
/// sums of the matrix's gradient ([`split`](crate::split)).
pub(crate) fn dense(
    x: tensor::Tensor<2>,
    (weight, bias): (tensor::Tensor<2>, tensor::Tensor<1>),
    function: Activation,
    precision: Precision,
    parts: usize,
) -> tensor::Tensor<2> {
    apply(Dense { function, precision, parts }, (x, weight, bias))
}

#[derive(Debug)]
struct Dense {
    function: Activation,
    precision: Precision,
    parts: usize,
}

impl Dense {
    /// The product of matrices, or of as many, no more exact than is asked for.
    fn product(&self, a: CubeTensor, b: CubeTensor) -> CubeTensor {
        let product = match self.precision {
            Precision::F32 | Precision::Tf32 => CubeBackend::float_matmul(a, b),
            Precision::Bf16 => {
                let [a, b] = [a, b].map(|factor| CubeBackend::float_cast(factor, FloatDType::BF16));
                CubeBackend::float_cast(CubeBackend::float_matmul(a, b), FloatDType::F32)
            }
        };
        into_contiguous(product)
    }
}

impl CubeKernel for Dense {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [x, weight, bias] = inputs else { unreachable!("a layer has an input, a matrix and a bias") };
        let out = self.product(x.clone(), weight.clone());
        launch!(activate::launch, out.meta.num_elements(); &out, bias; self.function);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [x, weight, bias] = pass.inputs else { unreachable!("a layer has an input, a matrix and a bias") };
        let out = pass.output;
        let [rows, columns] = out.meta.shape().dims();
        let sums = THREADS.div_ceil(columns).clamp(1, rows);
        let (dy, bias_sums) = (empty_like(out), empty(out, [sums, columns]));
        launch!(activate_backward::launch, sums * columns; out, pass.grad, &dy, &bias_sums; sums, self.function);
        let [x, dy_parts] = [x, &dy].map(|tensor| {
            let columns = tensor.meta.shape()[1];
            reshape(tensor.clone(), Shape::new([self.parts, rows / self.parts, columns]))
        });
        let parts = self.product(CubeBackend::float_swap_dims(x, 1, 2), dy_parts);
        let (dweight, dbias) = (empty_like(weight), empty_like(bias));
        let numbers = weight.meta.num_elements();
        launch!(
            add_up::launch, numbers + columns; &parts, &bias_sums, &dweight, &dbias;
            self.parts, sums
        );
        let dx = pass.wanted[0].then(|| self.product(dy, CubeBackend::float_transpose(weight.clone())));
        vec![dx, Some(dweight), Some(dbias)]
    }
}

/// The sums of a matrix's gradient, `[parts, k, n]`, and those of a bias's, `[sums, n]`.
#[cube(launch)]
fn add_up(
    parts: &Tensor<f32>,
    bias_sums: &Tensor<f32>,
    dweight: &mut Tensor<f32>,
    dbias: &mut Tensor<f32>,
    part_count: usize,
    sums: usize,
) {
    let numbers = dweight.len();
    if ABSOLUTE_POS >= numbers + dbias.len() {
        terminate!();
    }
    let mut sum = 0.0f32;
    if ABSOLUTE_POS < numbers {
        for part in 0..part_count {
            sum += parts[part * numbers + ABSOLUTE_POS];
        }
        dweight[ABSOLUTE_POS] = sum;
    } else {
        let column = ABSOLUTE_POS - numbers;
        for part in 0..sums {
            sum += bias_sums[part * dbias.len() + column];
        }
        dbias[column] = sum;
    }
}

/// In place; what is no number stays that.
#[cube(launch)]
fn activate(y: &mut Tensor<f32>, bias: &Tensor<f32>, #[comptime] function: Activation) {
    if ABSOLUTE_POS >= y.len() {
        terminate!();
    }
    let x = y[ABSOLUTE_POS] + bias[ABSOLUTE_POS % y.shape(1)];
    y[ABSOLUTE_POS] = activated(x, function);
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
        let slope = before_activation(out[at], grad[at], function);
        dy[at] = slope;
        sum += slope;
        row += sums;
    }
    partial[ABSOLUTE_POS] = sum;
}
