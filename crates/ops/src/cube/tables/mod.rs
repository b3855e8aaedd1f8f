//! Reading of planes and lines, and the frequencies of the position: all that goes into a factored field's MLP.

mod kernels;

use std::sync::Arc;

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, backend_extension};
use burn::cubecl::features::AtomicUsage;
use burn::cubecl::ir::{FloatKind, Type};
use burn::tensor::Tensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;

use self::kernels::{Exchange, Native};
use super::{threads, upload, zeros};
use crate::factored::{Layout, Level, PLANES, Query};

/// The MLP's input at the points of `query`, `[M, layout.features()]`; differentiable in `tables`.
pub(crate) fn features(tables: Tensor<1>, layout: &Arc<Layout>, query: &Query) -> Tensor<2> {
    let device = tables.device();
    let frequencies: Vec<f32> = query.frequency_weights.iter().copied().chain([0.0]).collect();
    Tensor::from_dispatch(<Dispatch as TableOps>::features(
        tables.into_dispatch(),
        upload(&query.positions, 3, &device).into_dispatch(),
        upload(&frequencies, 1, &device).into_dispatch(),
        Plan { layout: layout.clone(), level_weights: query.level_weights.clone() },
    ))
}

#[derive(Clone, Debug)]
struct Plan {
    layout: Arc<Layout>,
    level_weights: Vec<f32>,
}

impl Plan {
    /// Levels that count, with their weights.
    fn levels(&self) -> impl Iterator<Item = (&Level, f32)> {
        self.layout.levels.iter().zip(self.level_weights.iter().copied()).filter(|&(_, weight)| weight != 0.0)
    }
}

#[backend_extension(Cube, Autodiff)]
trait TableOps: Backend {
    fn features(
        tables: FloatTensor<Self>,
        positions: FloatTensor<Self>,
        frequencies: FloatTensor<Self>,
        plan: Plan,
    ) -> FloatTensor<Self>;
}

impl TableOps for CubeBackend {
    fn features(tables: CubeTensor, positions: CubeTensor, frequencies: CubeTensor, plan: Plan) -> CubeTensor {
        let [tables, positions, frequencies] = [tables, positions, frequencies].map(into_contiguous);
        let samples = positions.meta.shape()[0];
        // Zero where a level does not count.
        let out = zeros(&tables, [samples, plan.layout.features()]);
        let (count, dim) = threads(&tables, samples * 3);
        kernels::frequencies::launch(
            &out.client,
            count.clone(),
            dim,
            positions.clone().into_tensor_arg(),
            frequencies.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            plan.layout.frequencies,
        );
        for (level, weight) in plan.levels() {
            kernels::products::launch(
                &out.client,
                count.clone(),
                dim,
                tables.clone().into_tensor_arg(),
                positions.clone().into_tensor_arg(),
                out.clone().into_tensor_arg(),
                level.offset,
                level.feature,
                level.resolution,
                weight,
                level.channels,
            );
        }
        out
    }
}

/// The gradient with respect to the tables, where many samples add to one number.
fn pull(tables: &CubeTensor, positions: &CubeTensor, grad: CubeTensor, plan: &Plan) -> CubeTensor {
    let usage = tables.client.properties().atomic_type_usage(Type::atomic(FloatKind::F32));
    let launch = match usage.contains(AtomicUsage::Add) {
        true => kernels::products_backward::launch::<Native>,
        false => kernels::products_backward::launch::<Exchange>,
    };
    let dtables = zeros(tables, tables.meta.shape().clone());
    let (count, dim) = threads(tables, positions.meta.shape()[0] * PLANES.len());
    for (level, weight) in plan.levels() {
        launch(
            &tables.client,
            count.clone(),
            dim,
            tables.clone().into_tensor_arg(),
            positions.clone().into_tensor_arg(),
            grad.clone().into_tensor_arg(),
            dtables.clone().into_tensor_arg(),
            level.offset,
            level.feature,
            level.resolution,
            weight,
            level.channels,
        );
    }
    dtables
}

#[derive(Debug)]
struct FeaturesBackward;

#[derive(Clone, Debug)]
struct Saved {
    tables: CubeTensor,
    positions: CubeTensor,
    plan: Plan,
}

impl Backward<CubeBackend, 1> for FeaturesBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let Saved { tables, positions, plan } = ops.state;
        let grad = into_contiguous(grads.consume::<CubeBackend>(&ops.node));
        let [parent] = ops.parents;
        if let Some(node) = parent {
            grads.register::<CubeBackend>(node.id, pull(&tables, &positions, grad, &plan));
        }
    }
}

impl<C: CheckpointStrategy> TableOps for Autodiff<CubeBackend, C> {
    fn features(
        tables: FloatTensor<Self>,
        positions: FloatTensor<Self>,
        frequencies: FloatTensor<Self>,
        plan: Plan,
    ) -> FloatTensor<Self> {
        let guard = tables.node();
        let [tables, positions, frequencies] =
            [tables, positions, frequencies].map(|t| into_contiguous(t.into_primitive()));
        let output = CubeBackend::features(tables.clone(), positions.clone(), frequencies, plan.clone());
        match FeaturesBackward.prepare::<C>([guard]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(Saved { tables, positions, plan }, output),
            OpsKind::UnTracked(prep) => prep.finish(output),
        }
    }
}
