//! GPU kernels of the input of a factored field's MLP: planes, lines, and frequencies of the position.

mod kernels;

use std::sync::Arc;

use burn::cubecl::features::AtomicUsage;
use burn::cubecl::ir::{FloatKind, Type};
use burn::tensor::{DType, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::ops::numeric::zeros_client;
use burn_cubecl::tensor::CubeTensor;

use super::{FactoredLayout, PLANES, Query};
use crate::cube::{Operation, Pass, apply, empty, empty_like, launch, uploaded};
use kernels::{CompareExchange, Native};

/// Computes the MLP's input at the points of `query`, `[M, layout.features()]`; differentiable in `tables` and positions.
pub(super) fn features(tables: Tensor<1>, layout: &Arc<FactoredLayout>, query: &Query) -> Tensor<2> {
    let weights = [query.frequency_weights.as_slice(), &query.level_weights].concat();
    let kernel = FeatureKernel { layout: layout.clone(), weights };
    apply(kernel, [tables.into_dispatch(), query.positions.clone().into_dispatch()])
}

#[derive(Debug)]
struct FeatureKernel {
    layout: Arc<FactoredLayout>,
    /// Weights of the frequencies, then of the levels.
    weights: Vec<f32>,
}

impl Operation<CubeBackend> for FeatureKernel {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [tables, positions] = inputs else { unreachable!("tables are read at positions") };
        let samples = positions.meta.shape()[0];
        let out = empty(tables, [samples, self.layout.features()]);
        let weights = uploaded(&self.weights, tables);
        let (count, frequencies, levels) =
            (samples * PLANES.len(), self.layout.frequencies, self.layout.levels.clone());
        launch!(kernels::features::launch, count; tables, positions, &weights, &out; frequencies, levels);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [tables, positions] = pass.inputs else { unreachable!("tables are read at positions") };
        let (samples, weights) = (positions.meta.shape()[0], uploaded(&self.weights, tables));
        let in_tables = || {
            // Many samples add to one element of the tables.
            let usage = tables.client.properties().atomic_type_usage(Type::atomic(FloatKind::F32));
            let launch = match usage.contains(AtomicUsage::Add) {
                true => kernels::table_gradient::launch::<Native>,
                false => kernels::table_gradient::launch::<CompareExchange>,
            };
            // Tables are a single row, which is never padded.
            let shape = tables.meta.shape().clone();
            let dtables = zeros_client(tables.client.clone(), tables.device.clone(), shape, DType::F32);
            launch!(
                launch, samples * PLANES.len();
                tables, positions, &weights, pass.grad, &dtables;
                self.layout.frequencies, self.layout.levels.clone()
            );
            dtables
        };
        let in_positions = || {
            let dpositions = empty_like(positions);
            launch!(
                kernels::position_gradient::launch, samples;
                tables, positions, &weights, pass.output, pass.grad, &dpositions;
                self.layout.frequencies, self.layout.levels.clone()
            );
            dpositions
        };
        vec![pass.wanted[0].then(in_tables), pass.wanted[1].then(in_positions)]
    }
}
