//! Operations along rays, one thread a ray.

mod kernels;

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Autodiff, Backend, Dispatch, backend_extension};
use burn::tensor::{Device, Int, Tensor, TensorData};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;

use super::{empty, threads};
use crate::Segments;
use crate::composite::MIN_ALPHA_SUM;

/// [`composite`](crate::composite())'s results, packed: values, Σw, Σα and entropy, `[R, C + 3]`.
pub(crate) fn composite(tau: Tensor<1>, values: Tensor<2>, segments: &Segments, entropy: Option<f32>) -> Tensor<2> {
    let offsets = offsets(segments, &tau.device());
    Tensor::from_dispatch(<Dispatch as RayOps>::composite(
        tau.into_dispatch(),
        values.into_dispatch(),
        offsets.into_dispatch(),
        entropy,
    ))
}

/// [`information_gain`](crate::information_gain), `[R]`.
pub(crate) fn gain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    let offsets = offsets(segments, &tau.device());
    Tensor::from_dispatch(<Dispatch as RayOps>::gain(
        tau.into_dispatch(),
        near.into_dispatch(),
        offsets.into_dispatch(),
        epsilon,
    ))
}

fn offsets(segments: &Segments, device: &Device) -> Tensor<1, Int> {
    let offsets: Vec<i32> = std::iter::once(0).chain(segments.ranges().map(|range| range.end as i32)).collect();
    let count = offsets.len();
    Tensor::from_data(TensorData::new(offsets, [count]), &device.clone().inner())
}

/// Operations along rays, whose samples are packed as `offsets` says.
#[backend_extension(Cube, Autodiff)]
trait RayOps: Backend {
    fn composite(
        tau: FloatTensor<Self>,
        values: FloatTensor<Self>,
        offsets: IntTensor<Self>,
        entropy: Option<f32>,
    ) -> FloatTensor<Self>;

    fn gain(
        tau: FloatTensor<Self>,
        near: FloatTensor<Self>,
        offsets: IntTensor<Self>,
        epsilon: f32,
    ) -> FloatTensor<Self>;
}

fn rays(offsets: &CubeTensor) -> usize {
    offsets.meta.shape()[0] - 1
}

impl RayOps for CubeBackend {
    fn composite(tau: CubeTensor, values: CubeTensor, offsets: CubeTensor, entropy: Option<f32>) -> CubeTensor {
        let [tau, values] = [tau, values].map(into_contiguous);
        let (rays, channels) = (rays(&offsets), values.meta.shape()[1]);
        let out = empty(&tau, [rays, channels + 3]);
        let (count, dim) = threads(&tau, rays);
        kernels::composite_forward::launch(
            &out.client,
            count,
            dim,
            tau.into_tensor_arg(),
            values.into_tensor_arg(),
            offsets.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            entropy.unwrap_or_default(),
            MIN_ALPHA_SUM,
            channels,
            entropy.is_some(),
        );
        out
    }

    fn gain(tau: CubeTensor, near: CubeTensor, offsets: CubeTensor, epsilon: f32) -> CubeTensor {
        let [tau, near] = [tau, near].map(into_contiguous);
        let rays = rays(&offsets);
        let out = empty(&tau, [rays]);
        let (count, dim) = threads(&tau, rays);
        kernels::gain_forward::launch(
            &out.client,
            count,
            dim,
            tau.into_tensor_arg(),
            near.into_tensor_arg(),
            offsets.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            epsilon,
            MIN_ALPHA_SUM,
        );
        out
    }
}

/// Gradients of an operation of two inputs, given theirs and the output's.
trait Pullback: Clone + std::fmt::Debug + Send + 'static {
    fn pull(&self, inputs: [CubeTensor; 2], offsets: CubeTensor, grad: CubeTensor) -> [CubeTensor; 2];
}

#[derive(Clone, Debug)]
struct CompositePullback {
    entropy: Option<f32>,
}

impl Pullback for CompositePullback {
    fn pull(&self, [tau, values]: [CubeTensor; 2], offsets: CubeTensor, grad: CubeTensor) -> [CubeTensor; 2] {
        let channels = values.meta.shape()[1];
        let (count, dim) = threads(&tau, rays(&offsets));
        let (dtau, dvalues) = (empty(&tau, tau.meta.shape().clone()), empty(&tau, values.meta.shape().clone()));
        kernels::composite_backward::launch(
            &tau.client.clone(),
            count,
            dim,
            tau.into_tensor_arg(),
            values.into_tensor_arg(),
            offsets.into_tensor_arg(),
            grad.into_tensor_arg(),
            dtau.clone().into_tensor_arg(),
            dvalues.clone().into_tensor_arg(),
            self.entropy.unwrap_or_default(),
            MIN_ALPHA_SUM,
            channels,
            self.entropy.is_some(),
        );
        [dtau, dvalues]
    }
}

#[derive(Clone, Debug)]
struct GainPullback {
    epsilon: f32,
}

impl Pullback for GainPullback {
    fn pull(&self, [tau, near]: [CubeTensor; 2], offsets: CubeTensor, grad: CubeTensor) -> [CubeTensor; 2] {
        let (count, dim) = threads(&tau, rays(&offsets));
        let [dtau, dnear] = [&tau, &near].map(|input| empty(input, input.meta.shape().clone()));
        kernels::gain_backward::launch(
            &tau.client.clone(),
            count,
            dim,
            tau.into_tensor_arg(),
            near.into_tensor_arg(),
            offsets.into_tensor_arg(),
            grad.into_tensor_arg(),
            dtau.clone().into_tensor_arg(),
            dnear.clone().into_tensor_arg(),
            self.epsilon,
            MIN_ALPHA_SUM,
        );
        [dtau, dnear]
    }
}

#[derive(Debug)]
struct RayBackward<P>(std::marker::PhantomData<P>);

#[derive(Clone, Debug)]
struct Saved<P> {
    inputs: [CubeTensor; 2],
    offsets: CubeTensor,
    pullback: P,
}

impl<P: Pullback> Backward<CubeBackend, 2> for RayBackward<P> {
    type State = Saved<P>;

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let Saved { inputs, offsets, pullback } = ops.state;
        let grad = into_contiguous(grads.consume::<CubeBackend>(&ops.node));
        let results = pullback.pull(inputs, offsets, grad);
        for (parent, result) in ops.parents.into_iter().zip(results) {
            if let Some(node) = parent {
                grads.register::<CubeBackend>(node.id, result);
            }
        }
    }
}

type Tracked<C> = FloatTensor<Autodiff<CubeBackend, C>>;

fn tracked<C: CheckpointStrategy, P: Pullback>(
    inputs: [Tracked<C>; 2],
    offsets: CubeTensor,
    pullback: P,
    forward: impl FnOnce([CubeTensor; 2], CubeTensor) -> CubeTensor,
) -> Tracked<C> {
    let guards = inputs.each_ref().map(|input| input.node());
    let inputs = inputs.map(|input| into_contiguous(input.into_primitive()));
    let output = forward(inputs.clone(), offsets.clone());
    match RayBackward::<P>(std::marker::PhantomData).prepare::<C>(guards).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Saved { inputs, offsets, pullback }, output),
        OpsKind::UnTracked(prep) => prep.finish(output),
    }
}

impl<C: CheckpointStrategy> RayOps for Autodiff<CubeBackend, C> {
    fn composite(tau: Tracked<C>, values: Tracked<C>, offsets: CubeTensor, entropy: Option<f32>) -> Tracked<C> {
        tracked::<C, _>([tau, values], offsets, CompositePullback { entropy }, |[tau, values], offsets| {
            CubeBackend::composite(tau, values, offsets, entropy)
        })
    }

    fn gain(tau: Tracked<C>, near: Tracked<C>, offsets: CubeTensor, epsilon: f32) -> Tracked<C> {
        tracked::<C, _>([tau, near], offsets, GainPullback { epsilon }, |[tau, near], offsets| {
            CubeBackend::gain(tau, near, offsets, epsilon)
        })
    }
}
