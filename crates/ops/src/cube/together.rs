//! Many arrays moved to a GPU at once.

use burn::tensor::{self, Device};
use burn_cubecl::tensor::CubeTensor;

use super::outputs::{ALIGNMENT, part};
use super::{CubeKernel, Pass, apply};
use crate::upload;

/// Each of `arrays` as a tensor, all of them parts of one buffer.
pub(crate) fn together<const N: usize>(arrays: [Vec<f32>; N], device: &Device) -> [tensor::Tensor<1>; N] {
    let mut all = Vec::with_capacity(arrays.iter().map(|array| array.len().next_multiple_of(ALIGNMENT)).sum());
    let parts = arrays.map(|array| {
        let part = Part { start: all.len(), count: array.len() };
        all.extend(array);
        all.resize(all.len().next_multiple_of(ALIGNMENT), 0.0);
        part
    });
    let total = all.len();
    let all = upload(all, [total], device);
    parts.map(|part| match part.count {
        0 => tensor::Tensor::empty([0], device),
        _ => apply(part, all.clone()),
    })
}

/// Some numbers of a buffer, without a launch. There is no gradient.
#[derive(Debug)]
struct Part {
    start: usize,
    count: usize,
}

impl CubeKernel for Part {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        part(inputs[0].clone(), self.start, [self.count])
    }

    fn backward(&self, _pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        vec![None]
    }
}
