//! Rows of a tensor as tensors of their own, whose gradients are put together in one launch.

use std::sync::Arc;

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::outputs::Outputs;
use super::{CubeKernel, Pass, apply, empty_like};

/// As many as the kernel has inputs.
pub(crate) const MOST_PARTS: usize = 4;

/// [`split_rows`](crate::split_rows()) for at most [`MOST_PARTS`], none of them empty.
pub(crate) fn split_rows<const D: usize>(tensor: tensor::Tensor<D>, counts: &[usize]) -> Vec<tensor::Tensor<D>> {
    let mut shape = tensor.dims();
    let shapes = std::array::from_fn(|part| {
        shape[0] = counts.get(part).copied().unwrap_or(0);
        Shape::new(shape)
    });
    let parts = Outputs::dense(shapes);
    let whole = apply(Rows(parts.clone()), tensor);
    (0..counts.len()).map(|index| parts.output(&whole, index)).collect()
}

#[derive(Debug)]
struct Rows(Arc<Outputs<MOST_PARTS>>);

impl CubeKernel for Rows {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let whole = inputs[0].clone();
        let numbers = Shape::new([whole.meta.num_elements()]);
        reshape(whole, numbers)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let whole = empty_like(&pass.inputs[0]);
        let grads = self.0.gradients();
        let [a, b, c, d] = grads.each_ref().map(|grad| grad.as_ref().unwrap_or(pass.grad));
        let [_, b_start, c_start, d_start] = self.0.starts();
        let [has_a, has_b, has_c, has_d] = grads.each_ref().map(Option::is_some);
        launch!(
            join::launch, whole.meta.num_elements();
            a, b, c, d, &whole;
            b_start, c_start, d_start, has_a, has_b, has_c, has_d
        );
        vec![Some(whole)]
    }
}

/// Numbers of `a`, from `b_start` on of `b`, and so on; 0 for those of a part that there is not.
#[cube(launch)]
fn join(
    a: &Tensor<f32>,
    b: &Tensor<f32>,
    c: &Tensor<f32>,
    d: &Tensor<f32>,
    whole: &mut Tensor<f32>,
    b_start: usize,
    c_start: usize,
    d_start: usize,
    #[comptime] has_a: bool,
    #[comptime] has_b: bool,
    #[comptime] has_c: bool,
    #[comptime] has_d: bool,
) {
    let at = ABSOLUTE_POS;
    if at >= whole.len() {
        terminate!();
    }
    let mut value = 0.0f32;
    if at < b_start {
        if comptime!(has_a) {
            value = a[at];
        }
    } else if at < c_start {
        if comptime!(has_b) {
            value = b[at - b_start];
        }
    } else if at < d_start {
        if comptime!(has_c) {
            value = c[at - c_start];
        }
    } else if comptime!(has_d) {
        value = d[at - d_start];
    }
    whole[at] = value;
}
