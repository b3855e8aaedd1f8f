//! Several outputs of one operation as parts of one buffer, which are split without a launch.

use burn::tensor::{self, DType, Shape};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use super::{Operation, apply, empty};
use crate::segments::Segments;

/// Number of elements to a multiple of which the start of a part is rounded up: 512 bytes, which suit every device.
pub(super) const ALIGNMENT: usize = 128;

/// Returns the part of a buffer from `start`, a multiple of [`ALIGNMENT`], on as a tensor of `shape`.
fn part(buffer: CubeTensor, start: usize, shape: Shape) -> CubeTensor {
    let bytes = |elements: usize| (elements * size_of::<f32>()) as u64;
    let behind = buffer.meta.num_elements() - start - shape.num_elements();
    let handle = buffer.handle.offset_start(bytes(start)).offset_end(bytes(behind));
    CubeTensor::new_contiguous(buffer.client, buffer.device, shape, handle, buffer.dtype)
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
        std::array::from_fn(|index| part(buffer.clone(), self.starts[index], self.shapes[index].clone()))
    }

    /// Returns an output of the operation that filled the `buffer`.
    pub(crate) fn output<const D: usize>(&self, buffer: &tensor::Tensor<1>, index: usize) -> tensor::Tensor<D> {
        let (start, shape) = (self.starts[index], self.shapes[index].clone());
        apply(BufferPart { start, shape, segments: None }, [buffer.clone().into_dispatch()])
    }
}

/// Operation that takes a part of a buffer, without a launch and without a gradient.
#[derive(Debug)]
pub(super) struct BufferPart {
    pub(super) start: usize,
    pub(super) shape: Shape,
    /// Segments that cache the part: it holds their offsets, as the bits of integers.
    pub(super) segments: Option<Segments>,
}

impl Operation<CubeBackend> for BufferPart {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let part = part(inputs[0].clone(), self.start, self.shape.clone());
        if let Some(segments) = &self.segments {
            segments.on_gpu.get_or_init(|| CubeTensor { dtype: DType::I32, ..part.clone() });
        }
        part
    }
}
