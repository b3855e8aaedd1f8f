//! Upload of many arrays to a GPU at once.

use burn::tensor::{self, DType, Device};
use burn_cubecl::tensor::CubeTensor;

use super::outputs::{ALIGNMENT, part};
use super::{CubeKernel, apply};
use crate::segments::Segments;
use crate::traffic::upload;

/// Uploads `arrays` as parts of one buffer, which also holds the offsets of `segments`; each of these caches its offsets.
pub(crate) fn together<const N: usize>(
    arrays: [Vec<f32>; N],
    segments: &[&Segments],
    device: &Device,
) -> [tensor::Tensor<1>; N] {
    let mut all = Vec::with_capacity(arrays.iter().map(|array| array.len().next_multiple_of(ALIGNMENT)).sum());
    let mut add = |array: Vec<f32>| {
        let (start, count) = (all.len(), array.len());
        all.extend(array);
        all.resize(all.len().next_multiple_of(ALIGNMENT), 0.0);
        UploadedPart { start, count, segments: None }
    };
    let parts = arrays.map(&mut add);
    let offsets = segments.iter().map(|&segments| {
        let bits = segments.offsets().iter().map(|offset| f32::from_bits(*offset)).collect();
        UploadedPart { segments: Some(segments.clone()), ..add(bits) }
    });
    let offsets: Vec<UploadedPart> = offsets.collect();
    let total = all.len();
    let all = upload(all, [total], device);
    for part in offsets {
        apply::<1>(part, all.clone());
    }
    parts.map(|part| match part.count {
        0 => tensor::Tensor::empty([0], device),
        _ => apply(part, all.clone()),
    })
}

/// Part of a buffer, taken without a launch and without a gradient.
#[derive(Debug)]
struct UploadedPart {
    start: usize,
    count: usize,
    /// Segments whose offsets the part holds, as the bits of integers.
    segments: Option<Segments>,
}

impl CubeKernel for UploadedPart {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let part = part(inputs[0].clone(), self.start, [self.count]);
        if let Some(segments) = &self.segments {
            segments.on_gpu.get_or_init(|| CubeTensor { dtype: DType::I32, ..part.clone() });
        }
        part
    }
}
