//! Several tensors as parts of one buffer: outputs of one operation, and arrays that are uploaded at once. Parts share the memory
//! of the buffer, so that no launch splits it.

use burn::tensor::{self, DType, Device, Shape};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use super::{Operation, apply, empty, untracked};
use crate::segments::Segments;
use crate::traffic::upload;

/// Number of elements to a multiple of which the start of a part is rounded up: 512 bytes, which suit every device.
const ALIGNMENT: usize = 128;

/// Operation that takes a part of a buffer, without a gradient.
#[derive(Clone, Debug)]
struct BufferPart {
    /// First element, a multiple of [`ALIGNMENT`].
    start: usize,
    shape: Shape,
}

impl BufferPart {
    fn of(&self, buffer: &CubeTensor) -> CubeTensor {
        let Self { start, shape } = self.clone();
        let bytes = |elements: usize| (elements * size_of::<f32>()) as u64;
        let behind = buffer.meta.num_elements() - start - shape.num_elements();
        let CubeTensor { client, handle, device, dtype, .. } = buffer.clone();
        let handle = handle.offset_start(bytes(start)).offset_end(bytes(behind));
        CubeTensor::new_contiguous(client, device, shape, handle, dtype)
    }
}

impl Operation<CubeBackend> for BufferPart {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.of(&inputs[0])
    }
}

/// Places of an operation's outputs in one buffer. The operation has no gradient.
#[derive(Clone, Debug)]
pub(crate) struct Outputs<const N: usize>([BufferPart; N]);

impl<const N: usize> Outputs<N> {
    pub(crate) fn new(shapes: [Shape; N]) -> Self {
        let mut end = 0;
        Self(shapes.map(|shape| {
            let start = end;
            end += shape.num_elements().next_multiple_of(ALIGNMENT);
            BufferPart { start, shape }
        }))
    }

    /// Allocates the buffer.
    pub(crate) fn buffer(&self, like: &CubeTensor) -> CubeTensor {
        let BufferPart { start, shape } = &self.0[N - 1];
        empty(like, [start + shape.num_elements().next_multiple_of(ALIGNMENT)])
    }

    /// Returns the outputs, to be filled by a kernel.
    pub(crate) fn parts(&self, buffer: &CubeTensor) -> [CubeTensor; N] {
        self.0.each_ref().map(|part| part.of(buffer))
    }

    /// Returns an output of the operation that filled the `buffer`.
    pub(crate) fn output<const D: usize>(&self, buffer: &tensor::Tensor<1>, index: usize) -> tensor::Tensor<D> {
        apply(self.0[index].clone(), [buffer.clone().into_dispatch()])
    }
}

/// Uploads `arrays` as parts of one buffer, which also holds the offsets of `segments`; each of these caches its offsets.
pub(crate) fn upload_together<const N: usize>(
    arrays: [Vec<f32>; N],
    segments: &[&Segments],
    device: &Device,
) -> [tensor::Tensor<1>; N] {
    let mut all = Vec::with_capacity(arrays.iter().map(|array| array.len().next_multiple_of(ALIGNMENT)).sum());
    let mut add = |array: Vec<f32>| {
        let (start, shape) = (all.len(), Shape::new([array.len()]));
        all.extend(array);
        all.resize(all.len().next_multiple_of(ALIGNMENT), 0.0);
        BufferPart { start, shape }
    };
    let parts = arrays.map(&mut add);
    // Offsets are uploaded as the bits of integers.
    let bits = |segments: &Segments| segments.offsets().iter().map(|offset| f32::from_bits(*offset)).collect();
    let offsets: Vec<BufferPart> = segments.iter().map(|segments| add(bits(segments))).collect();
    let total = all.len();
    let all = upload(all, [total], device);
    for (segments, part) in segments.iter().zip(offsets) {
        let integers = || CubeTensor { dtype: DType::I32, ..part.of(&untracked(all.clone().inner())) };
        segments.on_gpu.get_or_init(integers);
    }
    parts.map(|part| match part.shape.num_elements() {
        0 => tensor::Tensor::empty([0], device),
        _ => apply(part, [all.clone().into_dispatch()]),
    })
}
