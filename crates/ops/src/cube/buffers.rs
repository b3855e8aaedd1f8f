//! Several tensors as parts of one buffer: outputs of one operation, and arrays that are uploaded at once. Parts share the memory
//! of the buffer, so that no launch splits it.

use burn::backend::DispatchTensor;
use burn::tensor::{self, DType, Device, Shape};
use burn_cubecl::tensor::CubeTensor;

use super::{apply_without_gradient, empty, untracked};
use crate::segments::Segments;
use crate::traffic::upload;

/// Number of elements to a multiple of which the start of a part is rounded up: 512 bytes, which suit every device.
const ALIGNMENT: usize = 128;

/// Part of a buffer.
#[derive(Clone)]
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

    /// Returns the part of `buffer` as a tensor without a gradient.
    fn tensor<const D: usize>(self, buffer: &tensor::Tensor<1>) -> tensor::Tensor<D> {
        apply_without_gradient([buffer.clone().into_dispatch()], move |[buffer]| self.of(buffer))
    }
}

/// Outputs of an operation without gradients, as parts of one buffer.
pub(crate) struct Outputs<const N: usize> {
    buffer: tensor::Tensor<1>,
    parts: [BufferPart; N],
}

impl<const N: usize> Outputs<N> {
    /// Allocates outputs of the given shapes, which `fill` writes.
    pub(crate) fn new<const I: usize>(
        shapes: [Shape; N],
        inputs: [DispatchTensor; I],
        fill: impl Fn(&[CubeTensor; I], [CubeTensor; N]) + Send + Sync + 'static,
    ) -> Self {
        let mut end = 0;
        let parts = shapes.map(|shape| {
            let start = end;
            end += shape.num_elements().next_multiple_of(ALIGNMENT);
            BufferPart { start, shape }
        });
        let places = parts.clone();
        let buffer = apply_without_gradient(inputs, move |inputs| {
            let buffer = empty(&inputs[0], [end]);
            fill(inputs, places.each_ref().map(|part| part.of(&buffer)));
            buffer
        });
        Self { buffer, parts }
    }

    pub(crate) fn output<const D: usize>(&self, index: usize) -> tensor::Tensor<D> {
        self.parts[index].clone().tensor(&self.buffer)
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
    let bits = |segments: &Segments| segments.offsets().iter().map(|offset| f32::from_bits(*offset as u32)).collect();
    let offsets: Vec<BufferPart> = segments.iter().map(|segments| add(bits(segments))).collect();
    let total = all.len();
    let all = upload(all, [total], device);
    for (segments, part) in segments.iter().zip(offsets) {
        let integers = || CubeTensor { dtype: DType::I32, ..part.of(&untracked(all.clone().inner())) };
        segments.on_gpu.get_or_init(integers);
    }
    parts.map(|part| match part.shape.num_elements() {
        0 => tensor::Tensor::empty([0], device),
        _ => part.tensor(&all),
    })
}
