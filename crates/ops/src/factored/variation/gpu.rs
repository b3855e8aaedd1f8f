//! GPU kernel of [`plane_variation`](super::plane_variation): one launch for all levels, whose sizes are compile-time constants.

use std::sync::Arc;

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::{self, prelude::*};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use super::{FactoredLayout, weight};
use crate::cube::{Operation, Pass, empty, empty_like, launch};
use crate::factored::Level;

const SUMS: usize = 4096;

#[derive(Debug)]
pub(super) struct GpuVariation(pub(super) Arc<FactoredLayout>);

impl Operation<CubeBackend> for GpuVariation {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let tables = &inputs[0];
        let sums = empty(tables, [SUMS]);
        launch!(squares::launch, SUMS; tables, &sums; self.0.levels.clone());
        CubeBackend::float_sum(sums)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let tables = &pass.inputs[0];
        let dtables = empty_like(tables);
        launch!(gradient::launch, dtables.meta.num_elements(); tables, pass.grad, &dtables; self.0.levels.clone());
        vec![Some(dtables)]
    }
}

/// Sums squared differences to the next texel along both axes; each thread strides through the elements of every level.
#[cube(launch)]
fn squares(tables: &Tensor<f32>, sums: &mut Tensor<f32>, #[comptime] levels: Vec<Level>) {
    if ABSOLUTE_POS >= sums.len() {
        terminate!();
    }
    let mut all = 0.0f32;
    #[unroll]
    for l in 0..levels.len() {
        let offset = comptime!(levels[l].offset);
        let resolution = comptime!(levels[l].resolution);
        let channels = comptime!(levels[l].channels);
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
            at += sums.len();
        }
        all += comptime!(weight(levels[l].resolution)) * sum;
    }
    sums[ABSOLUTE_POS] = all;
}

/// Computes the gradient with respect to each element; 0 on lines.
#[cube(launch)]
fn gradient(tables: &Tensor<f32>, grad: &Tensor<f32>, dtables: &mut Tensor<f32>, #[comptime] levels: Vec<Level>) {
    let at = ABSOLUTE_POS;
    if at >= dtables.len() {
        terminate!();
    }
    let mut d = 0.0f32;
    #[unroll]
    for l in 0..levels.len() {
        let offset = comptime!(levels[l].offset);
        let resolution = comptime!(levels[l].resolution);
        let channels = comptime!(levels[l].channels);
        let row = resolution * channels;
        if at >= offset && at < offset + 3 * resolution * row {
            let (x, y) = ((at - offset) / channels % resolution, (at - offset) / row % resolution);
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
            d = comptime!(2.0 * weight(levels[l].resolution)) * grad[0] * sum;
        }
    }
    dtables[at] = d;
}
