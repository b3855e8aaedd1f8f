//! Several outputs of one operation as parts of one buffer, which are split without a launch.

use std::sync::{Arc, Mutex, PoisonError};

use burn::tensor::{self, Shape};
use burn_cubecl::kernel::slice;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, Pass, apply, empty};

/// Elements to whose multiples the start of a part is rounded up: half a kilobyte, at which every device can begin a buffer.
pub(super) const ALIGNMENT: usize = 128;

/// Returns the part of a buffer from `start` on as a tensor of `shape`.
pub(super) fn part<S: Into<Shape>>(buffer: CubeTensor, start: usize, shape: S) -> CubeTensor {
    let shape = shape.into();
    let bytes = |elements: usize| (elements * size_of::<f32>()) as u64;
    let behind = buffer.meta.num_elements() - start - shape.num_elements();
    let handle = buffer.handle.offset_start(bytes(start)).offset_end(bytes(behind));
    CubeTensor::new_contiguous(buffer.client, buffer.device, shape, handle, buffer.dtype)
}

/// Returns the part of a buffer from `start` on, to be read: a copy if the device cannot begin a buffer at `start`.
pub(crate) fn part_or_copy<S: Into<Shape>>(buffer: &CubeTensor, start: usize, shape: S) -> CubeTensor {
    let (buffer, shape) = (buffer.clone(), shape.into());
    let alignment = buffer.client.properties().memory.alignment as usize;
    if (start * size_of::<f32>()).is_multiple_of(alignment) {
        return part(buffer, start, shape);
    }
    reshape(slice(buffer, &[start..start + shape.num_elements()]), shape)
}

/// Places of an operation's outputs in its buffer; in the backward pass their gradients.
#[derive(Debug)]
pub(crate) struct Outputs<const N: usize> {
    starts: [usize; N],
    shapes: [Shape; N],
    grads: Mutex<[Option<CubeTensor>; N]>,
}

impl<const N: usize> Outputs<N> {
    /// Places outputs of these shapes at multiples of [`ALIGNMENT`].
    pub(crate) fn new(shapes: [Shape; N]) -> Arc<Self> {
        let mut end = 0;
        let starts = shapes.each_ref().map(|shape| {
            let start = end;
            end += shape.num_elements().next_multiple_of(ALIGNMENT);
            start
        });
        Arc::new(Self { starts, shapes, grads: Mutex::new([const { None }; N]) })
    }

    /// Allocates a buffer for all outputs.
    pub(crate) fn buffer(&self, like: &CubeTensor) -> CubeTensor {
        let last = &self.shapes[N - 1];
        empty(like, [self.starts[N - 1] + last.num_elements().next_multiple_of(ALIGNMENT)])
    }

    /// Returns each output in a buffer.
    pub(crate) fn parts(&self, buffer: &CubeTensor) -> [CubeTensor; N] {
        std::array::from_fn(|index| self.part(buffer, index))
    }

    fn part(&self, buffer: &CubeTensor, index: usize) -> CubeTensor {
        part_or_copy(buffer, self.starts[index], self.shapes[index].clone())
    }

    /// Returns an output of the operation that filled the `buffer`.
    pub(crate) fn output<const D: usize>(
        self: &Arc<Self>,
        buffer: &tensor::Tensor<1>,
        index: usize,
    ) -> tensor::Tensor<D> {
        apply(OutputPart { outputs: self.clone(), index }, buffer.clone())
    }

    /// Takes the gradient of each output, for the operation's backward pass; `None` if nothing depends on an output.
    pub(crate) fn gradients(&self) -> [Option<CubeTensor>; N] {
        std::mem::replace(&mut *self.grads.lock().unwrap_or_else(PoisonError::into_inner), [const { None }; N])
    }
}

/// Part of the output of the operation that filled its input.
#[derive(Debug)]
struct OutputPart<const N: usize> {
    outputs: Arc<Outputs<N>>,
    index: usize,
}

impl<const N: usize> CubeKernel for OutputPart<N> {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.outputs.part(&inputs[0], self.index)
    }

    /// Leaves the gradient in `outputs`. The first gradient is passed on in the graph, where it stands for all and is not read.
    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let mut grads = self.outputs.grads.lock().unwrap_or_else(PoisonError::into_inner);
        let is_first = grads.iter().all(Option::is_none);
        grads[self.index] = Some(pass.grad.clone());
        vec![is_first.then(|| pass.grad.clone())]
    }
}
