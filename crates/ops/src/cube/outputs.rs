//! Several outputs of one operation: parts of one buffer, which are taken apart without a launch, as their gradients are put
//! together.

use std::sync::{Arc, Mutex, PoisonError};

use burn::tensor::{self, Shape};
use burn_cubecl::kernel::slice;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, Pass, apply, empty};

/// Numbers to whose multiples a part's start is rounded up: half a kilobyte, which every device can begin a buffer at.
pub(super) const ALIGNMENT: usize = 128;

/// The part of a buffer from `start` on that holds a tensor of `shape`.
pub(super) fn part<S: Into<Shape>>(buffer: CubeTensor, start: usize, shape: S) -> CubeTensor {
    let shape = shape.into();
    let bytes = |numbers: usize| (numbers * size_of::<f32>()) as u64;
    let behind = buffer.meta.num_elements() - start - shape.num_elements();
    let handle = buffer.handle.offset_start(bytes(start)).offset_end(bytes(behind));
    CubeTensor::new_contiguous(buffer.client, buffer.device, shape, handle, buffer.dtype)
}

/// The same of a buffer that is there to be read: a copy where the device cannot begin a buffer at `start`.
pub(super) fn part_or_copy<S: Into<Shape>>(buffer: &CubeTensor, start: usize, shape: S) -> CubeTensor {
    let (buffer, shape) = (buffer.clone(), shape.into());
    let alignment = buffer.client.properties().memory.alignment as usize;
    if (start * size_of::<f32>()).is_multiple_of(alignment) {
        return part(buffer, start, shape);
    }
    reshape(slice(buffer, &[start..start + shape.num_elements()]), shape)
}

/// Where the outputs of an operation lie in its buffer, and on the way back their gradients.
#[derive(Debug)]
pub(super) struct Outputs<const N: usize> {
    starts: [usize; N],
    shapes: [Shape; N],
    grads: Mutex<[Option<CubeTensor>; N]>,
}

impl<const N: usize> Outputs<N> {
    /// Each at a multiple of [`ALIGNMENT`].
    pub(super) fn new(shapes: [Shape; N]) -> Arc<Self> {
        let mut end = 0;
        let starts = shapes.each_ref().map(|shape| {
            let start = end;
            end += shape.num_elements().next_multiple_of(ALIGNMENT);
            start
        });
        Arc::new(Self { starts, shapes, grads: Mutex::new([const { None }; N]) })
    }

    /// The number at which each begins.
    pub(super) fn starts(&self) -> [usize; N] {
        self.starts
    }

    /// A buffer for all of them.
    pub(super) fn buffer(&self, like: &CubeTensor) -> CubeTensor {
        let last = &self.shapes[N - 1];
        empty(like, [self.starts[N - 1] + last.num_elements().next_multiple_of(ALIGNMENT)])
    }

    /// Each of them.
    pub(super) fn parts(&self, buffer: &CubeTensor) -> [CubeTensor; N] {
        std::array::from_fn(|index| self.part(buffer, index))
    }

    fn part(&self, buffer: &CubeTensor, index: usize) -> CubeTensor {
        part_or_copy(buffer, self.starts[index], self.shapes[index].clone())
    }

    /// An output of the operation that filled the `buffer`.
    pub(super) fn output<const D: usize>(
        self: &Arc<Self>,
        buffer: &tensor::Tensor<1>,
        index: usize,
    ) -> tensor::Tensor<D> {
        apply(Output { outputs: self.clone(), index }, buffer.clone())
    }

    /// The gradient of each output, for the operation's backward pass; none of one that nothing depends on.
    pub(super) fn gradients(&self) -> [Option<CubeTensor>; N] {
        std::mem::replace(&mut *self.grads.lock().unwrap_or_else(PoisonError::into_inner), [const { None }; N])
    }
}

#[derive(Debug)]
struct Output<const N: usize> {
    outputs: Arc<Outputs<N>>,
    index: usize,
}

impl<const N: usize> CubeKernel for Output<N> {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.outputs.part(&inputs[0], self.index)
    }

    /// Hands the gradient over. What the graph is given stands for all of them, and is not looked at.
    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let mut grads = self.outputs.grads.lock().unwrap_or_else(PoisonError::into_inner);
        let is_first = grads.iter().all(Option::is_none);
        grads[self.index] = Some(pass.grad.clone());
        vec![is_first.then(|| pass.grad.clone())]
    }
}
