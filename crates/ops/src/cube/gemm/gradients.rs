//! Gradients of the weights of several layers, which are sums over all samples.

use burn::cubecl::{self, prelude::*};
use burn::tensor::Shape;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::kernel::End;
use super::product::{Factor, Product};
use super::{Layer, Order, Rows, dims};
use crate::cube::empty;
use crate::split::gpu_parts;

/// Sums over parts of the samples ([`split`](crate::split)), all of a part in one place, which one launch adds up at last.
#[derive(Debug)]
pub(in crate::cube) struct Gradients {
    /// `[parts, numbers]`
    sums: CubeTensor,
    parts: usize,
    numbers: usize,
}

impl Gradients {
    /// For layers that have `numbers` weights and biases, given as many samples.
    pub(in crate::cube) fn new(like: &CubeTensor, samples: usize, numbers: usize) -> Self {
        let parts = gpu_parts(samples);
        Self { sums: empty(like, [parts, numbers]), parts, numbers }
    }

    /// That of a `layer`'s W, xᵀ dy, to `weight`, and of its b, the sums of dy's columns, to `bias`.
    pub(in crate::cube) fn add(&self, layer: &Layer<'_>, x: Rows<'_>, dy: &CubeTensor, [weight, bias]: [usize; 2]) {
        let end = match layer.order {
            Order::ByInput => End::Gradient,
            Order::ByOutput => End::TransposedGradient,
        };
        let left = Factor::of_rows(x, layer.inputs, false);
        let right = Factor::of_rows(Rows::of(dy), layer.outputs, false);
        Product {
            out_start: weight,
            column_start: bias,
            parts: self.parts,
            part_numbers: self.numbers,
            ..Product::new(left, right, dims(dy)[0], end)
        }
        .launch(&self.sums);
    }

    /// All of them, `[numbers]`. What no layer was said to be in is undefined.
    pub(in crate::cube) fn added_up(self) -> CubeTensor {
        if self.parts == 1 {
            return reshape(self.sums, Shape::new([self.numbers]));
        }
        let out = empty(&self.sums, [self.numbers]);
        launch!(add_up::launch, self.numbers; &self.sums, &out; self.parts);
        out
    }
}

/// The sums of the columns of `[parts, numbers]`, one thread each.
#[cube(launch)]
fn add_up(sums: &Tensor<f32>, out: &mut Tensor<f32>, parts: usize) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let mut sum = 0.0f32;
    for part in 0..parts {
        sum += sums[part * out.len() + ABSOLUTE_POS];
    }
    out[ABSOLUTE_POS] = sum;
}
