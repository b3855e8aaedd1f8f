//! Dense layers in `f32`: products in tiles, whose factors no tensor core rounds, with what comes before and after in the same
//! launch.

mod gradients;
mod kernel;
mod product;
mod tile;

use burn_cubecl::tensor::CubeTensor;

pub(super) use self::gradients::Gradients;
use self::kernel::End;
use self::product::{Factor, Product};
use crate::mlp::Activation;

/// A matrix with a row per sample; or two of them, side by side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<'a> {
    first: &'a CubeTensor,
    second: Option<&'a CubeTensor>,
}

impl<'a> Rows<'a> {
    pub(super) fn of(first: &'a CubeTensor) -> Self {
        Self { first, second: None }
    }

    pub(super) fn beside(first: &'a CubeTensor, second: &'a CubeTensor) -> Self {
        Self { first, second: Some(second) }
    }
}

fn dims(matrix: &CubeTensor) -> [usize; 2] {
    matrix.meta.shape().dims()
}

/// In which order a layer's matrix lies in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// `[inputs, outputs]`
    ByInput,
    /// `[outputs, inputs]`
    ByOutput,
}

/// A layer y = f(x W + b), whose numbers are parts of buffers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer<'a> {
    /// Where W is, and where it begins there.
    pub(super) weight: (&'a CubeTensor, usize),
    /// The same of b.
    pub(super) bias: (&'a CubeTensor, usize),
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) order: Order,
}

/// What a layer's input is, to which its gradient is taken back.
#[derive(Clone, Copy, Debug)]
pub(super) enum Below<'a> {
    /// As it is.
    Nothing,
    /// Of a tensor that has a gradient already, to which this one is added.
    Shared,
    /// The value of a function.
    Function(&'a CubeTensor, Activation),
    /// The same, before which the outer product of a number of each sample and one of each input is added to the gradient.
    FunctionOfMore(&'a CubeTensor, Activation, [&'a CubeTensor; 2]),
}

impl Layer<'_> {
    /// `out` ← f(x W + b), `[M, outputs]` of `[M, inputs]`.
    pub(super) fn forward(&self, x: Rows<'_>, function: Activation, out: &CubeTensor) {
        let left = Factor::of_rows(x, dims(out)[0], true);
        let product = Product::new(left, self.weights(0, self.outputs, Order::ByOutput), self.inputs, End::Activation);
        let (bias, column_start) = self.bias;
        Product { column_input: Some(bias), column_start, function, ..product }.launch(out);
    }

    /// `out` ← dy Wᵀ for the inputs from `first` on, as many as it has columns, taken back to what is `below`.
    pub(super) fn input_gradient(&self, first: usize, dy: &CubeTensor, below: Below<'_>, out: &CubeTensor) {
        let [rows, inputs] = dims(out);
        let left = Factor::of_rows(Rows::of(dy), rows, true);
        let product = |end| Product::new(left, self.weights(first, inputs, Order::ByInput), self.outputs, end);
        match below {
            Below::Nothing => product(End::Nothing).launch(out),
            Below::Shared => product(End::Onto).launch(out),
            Below::Function(value, function) => {
                Product { kept: Some(value), function, ..product(End::Slope) }.launch(out);
            }
            Below::FunctionOfMore(value, function, [row, column]) => {
                let (row_input, column_input) = (Some(row), Some(column));
                Product { kept: Some(value), function, row_input, column_input, ..product(End::SlopeOfMore) }
                    .launch(out);
            }
        }
    }

    /// The matrix as the right factor of a product whose sums are over rows of a matrix in the given `order`: its outer indices
    /// are those from the `first` on, `outers` of them.
    fn weights(&self, first: usize, outers: usize, order: Order) -> Factor<'_> {
        let width = match self.order {
            Order::ByInput => self.outputs,
            Order::ByOutput => self.inputs,
        };
        let along_terms = self.order == order;
        let start = self.weight.1 + first * if along_terms { width } else { 1 };
        Factor { matrix: Rows::of(self.weight.0), start, width, outers, along_terms }
    }
}
