//! Upload of many arrays to a GPU at once.

use burn::tensor::{self, Device, Shape};

use super::apply;
use super::outputs::{ALIGNMENT, BufferPart};
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
        let (start, shape) = (all.len(), Shape::new([array.len()]));
        all.extend(array);
        all.resize(all.len().next_multiple_of(ALIGNMENT), 0.0);
        BufferPart { start, shape, segments: None }
    };
    let parts = arrays.map(&mut add);
    let offsets = segments.iter().map(|&segments| {
        let bits = segments.offsets().iter().map(|offset| f32::from_bits(*offset)).collect();
        BufferPart { segments: Some(segments.clone()), ..add(bits) }
    });
    let offsets: Vec<BufferPart> = offsets.collect();
    let total = all.len();
    let all = upload(all, [total], device);
    for part in offsets {
        apply::<1>(part, [all.clone().into_dispatch()]);
    }
    parts.map(|part| match part.shape.num_elements() {
        0 => tensor::Tensor::empty([0], device),
        _ => apply(part, [all.clone().into_dispatch()]),
    })
}
