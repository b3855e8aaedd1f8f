//! Total variation of planes: a launch per level, and one to add up.

use std::sync::Arc;

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::{self, prelude::*};
use burn::tensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, Pass, apply, empty, zeros};
use crate::factored::{Layout, variation_weight};

/// Partial sums of a level.
const SUMS: usize = 4096;

/// [`plane_variation`](crate::plane_variation), `[1]`.
pub(crate) fn variation(tables: tensor::Tensor<1>, layout: &Arc<Layout>) -> tensor::Tensor<1> {
    apply(Variation(layout.clone()), tables)
}

#[derive(Debug)]
struct Variation(Arc<Layout>);

impl CubeKernel for Variation {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let tables = &inputs[0];
        let sums = empty(tables, [self.0.levels.len() * SUMS]);
        for (index, level) in self.0.levels.iter().enumerate() {
            let weight = variation_weight(level.resolution);
            launch!(
                squares::launch, SUMS; tables, &sums;
                level.offset, level.resolution, level.channels, weight, index * SUMS, SUMS
            );
        }
        CubeBackend::float_sum(sums)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let tables = &pass.inputs[0];
        let dtables = zeros(tables, tables.meta.shape().clone());
        for level in &self.0.levels {
            launch!(
                pull::launch, 3 * level.plane_len(); tables, pass.grad, &dtables;
                level.offset, level.resolution, level.channels, 2.0 * variation_weight(level.resolution)
            );
        }
        vec![Some(dtables)]
    }
}

/// Squared differences to the next texel along both axes, every `threads`-th number of a level's planes per thread.
#[cube(launch)]
fn squares(
    tables: &Tensor<f32>,
    sums: &mut Tensor<f32>,
    offset: usize,
    resolution: usize,
    channels: usize,
    weight: f32,
    first: usize,
    threads: usize,
) {
    if ABSOLUTE_POS >= threads {
        terminate!();
    }
    let row = resolution * channels;
    let mut sum = 0.0f32;
    let mut at = ABSOLUTE_POS;
    while at < 3 * resolution * row {
        let here = tables[offset + at];
        if at / channels % resolution + 1 < resolution {
            let difference = tables[offset + at + channels] - here;
            sum += difference * difference;
        }
        if at / row % resolution + 1 < resolution {
            let difference = tables[offset + at + row] - here;
            sum += difference * difference;
        }
        at += threads;
    }
    sums[first + ABSOLUTE_POS] = weight * sum;
}

/// The gradient with respect to each number of a level's planes.
#[cube(launch)]
fn pull(
    tables: &Tensor<f32>,
    grad: &Tensor<f32>,
    dtables: &mut Tensor<f32>,
    offset: usize,
    resolution: usize,
    channels: usize,
    factor: f32,
) {
    let row = resolution * channels;
    if ABSOLUTE_POS >= 3 * resolution * row {
        terminate!();
    }
    let at = offset + ABSOLUTE_POS;
    let (x, y) = (ABSOLUTE_POS / channels % resolution, ABSOLUTE_POS / row % resolution);
    let here = tables[at];
    let mut sum = 0.0f32;
    if x > 0 {
        sum += here - tables[at - channels];
    }
    if x + 1 < resolution {
        sum += here - tables[at + channels];
    }
    if y > 0 {
        sum += here - tables[at - row];
    }
    if y + 1 < resolution {
        sum += here - tables[at + row];
    }
    dtables[at] = factor * grad[0] * sum;
}
