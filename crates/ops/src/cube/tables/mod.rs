//! Reading of planes and lines, and the frequencies of the position: all that goes into a factored field's MLP.

mod kernels;
mod network;

use std::sync::Arc;

use burn::cubecl::features::AtomicUsage;
use burn::cubecl::ir::{FloatKind, Type};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;

use self::kernels::{Exchange, Native};
use super::{CubeKernel, Pass, apply, empty, empty_like, numbers, zeros};
use crate::factored::{Layout, Level, PLANES, Query};

pub(crate) use network::network;

/// The MLP's input at the points of `query`, `[rows, layout.features()]`, zero from the last point on; differentiable in `tables`
/// and positions.
pub(crate) fn features(tables: Tensor<1>, layout: &Arc<Layout>, query: &Query, rows: usize) -> Tensor<2> {
    let kernel = Features {
        rows,
        layout: layout.clone(),
        frequency_weights: query.frequency_weights.clone(),
        level_weights: query.level_weights.clone(),
    };
    apply(kernel, (tables, query.positions.clone()))
}

/// Of tables and positions.
#[derive(Debug)]
struct Features {
    rows: usize,
    layout: Arc<Layout>,
    frequency_weights: Vec<f32>,
    level_weights: Vec<f32>,
}

impl Features {
    /// Levels that count, with their weights.
    fn levels(&self) -> impl Iterator<Item = (&Level, f32)> {
        self.layout.levels.iter().zip(self.level_weights.iter().copied()).filter(|&(_, weight)| weight != 0.0)
    }
}

impl CubeKernel for Features {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [tables, positions] = inputs else { unreachable!("tables are read at positions") };
        let samples = positions.meta.shape()[0];
        // Zero where a level does not count, and in rows that fill up.
        let is_filled = self.rows == samples && self.levels().count() == self.layout.levels.len();
        let allocate = if is_filled { empty::<[usize; 2]> } else { zeros::<[usize; 2]> };
        let out = allocate(tables, [self.rows, self.layout.features()]);
        let weights = numbers(&self.frequency_weights, tables);
        launch!(kernels::frequencies::launch, samples * 3; positions, &weights, &out; self.layout.frequencies);
        for (level, weight) in self.levels() {
            launch!(
                kernels::products::launch, samples * 3;
                tables, positions, &out;
                level.offset, level.feature, level.resolution, weight, level.channels
            );
        }
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [tables, positions] = pass.inputs else { unreachable!("tables are read at positions") };
        vec![
            pass.wanted[0].then(|| self.table_gradient(tables, positions, pass.grad)),
            pass.wanted[1].then(|| self.position_gradient(tables, positions, pass.output, pass.grad)),
        ]
    }
}

impl Features {
    /// Many samples add to one number of the tables.
    fn table_gradient(&self, tables: &CubeTensor, positions: &CubeTensor, grad: &CubeTensor) -> CubeTensor {
        let usage = tables.client.properties().atomic_type_usage(Type::atomic(FloatKind::F32));
        let launch = match usage.contains(AtomicUsage::Add) {
            true => kernels::products_backward::launch::<Native>,
            false => kernels::products_backward::launch::<Exchange>,
        };
        let dtables = zeros(tables, tables.meta.shape().clone());
        for (level, weight) in self.levels() {
            launch!(
                launch, positions.meta.shape()[0] * PLANES.len();
                tables, positions, grad, &dtables;
                level.offset, level.feature, level.resolution, weight, level.channels
            );
        }
        dtables
    }

    /// One thread per sample, level by level.
    fn position_gradient(
        &self,
        tables: &CubeTensor,
        positions: &CubeTensor,
        output: &CubeTensor,
        grad: &CubeTensor,
    ) -> CubeTensor {
        let dpositions = empty_like(positions);
        let samples = positions.meta.shape()[0];
        launch!(kernels::frequencies_backward::launch, samples * 3; output, grad, &dpositions; self.layout.frequencies);
        for (level, weight) in self.levels() {
            launch!(
                kernels::products_backward_in_positions::launch, samples;
                tables, positions, grad, &dpositions;
                level.offset, level.feature, level.resolution, weight, level.channels
            );
        }
        dpositions
    }
}
