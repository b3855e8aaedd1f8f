//! Several outputs of one operation as parts of one buffer, which are split without a launch.

use burn::tensor::{self, Shape};
use burn_cubecl::kernel::slice;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, apply, empty};

/// Number of elements to a multiple of which the start of a part is rounded up: 512 bytes, which suit every device.
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

/// Places of an operation's outputs in one buffer. The operation has no gradient.
#[derive(Clone, Debug)]
pub(crate) struct Outputs<const N: usize> {
    starts: [usize; N],
    shapes: [Shape; N],
}

impl<const N: usize> Outputs<N> {
    /// Places outputs of these shapes at multiples of [`ALIGNMENT`].
    pub(crate) fn new(shapes: [Shape; N]) -> Self {
        let mut end = 0;
        let starts = shapes.each_ref().map(|shape| {
            let start = end;
            end += shape.num_elements().next_multiple_of(ALIGNMENT);
            start
        });
        Self { starts, shapes }
    }

    pub(crate) fn buffer(&self, like: &CubeTensor) -> CubeTensor {
        let last = &self.shapes[N - 1];
        empty(like, [self.starts[N - 1] + last.num_elements().next_multiple_of(ALIGNMENT)])
    }

    pub(crate) fn parts(&self, buffer: &CubeTensor) -> [CubeTensor; N] {
        std::array::from_fn(|index| part_or_copy(buffer, self.starts[index], self.shapes[index].clone()))
    }

    /// Returns an output of the operation that filled the `buffer`.
    pub(crate) fn output<const D: usize>(&self, buffer: &tensor::Tensor<1>, index: usize) -> tensor::Tensor<D> {
        apply(OutputPart { start: self.starts[index], shape: self.shapes[index].clone() }, buffer.clone())
    }
}

/// Part of the output of the operation that filled its input.
#[derive(Debug)]
struct OutputPart {
    start: usize,
    shape: Shape,
}

impl CubeKernel for OutputPart {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        part_or_copy(&inputs[0], self.start, self.shape.clone())
    }
}
