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

/// [`composite`](crate::composite())'s results, packed: values and Σw, `[R, C + 1]`.
pub(crate) fn composite(tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Tensor<2> {
    let offsets = offsets(segments, &tau.device());
    Tensor::from_dispatch(<Dispatch as RayOps>::composite(
        tau.into_dispatch(),
        values.into_dispatch(),
        offsets.into_dispatch(),
    ))
}

/// [`ray_entropy`](crate::ray_entropy)'s results for α/Σα, packed: bits and Σα, `[R, 2]`.
pub(crate) fn entropy(tau: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<2> {
    let offsets = offsets(segments, &tau.device());
    Tensor::from_dispatch(<Dispatch as RayOps>::entropy(tau.into_dispatch(), offsets.into_dispatch(), epsilon))
}

/// [`ray_divergence`](crate::ray_divergence), `[R]`.
pub(crate) fn divergence(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    let offsets = offsets(segments, &tau.device());
    Tensor::from_dispatch(<Dispatch as RayOps>::divergence(
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
    fn composite(tau: FloatTensor<Self>, values: FloatTensor<Self>, offsets: IntTensor<Self>) -> FloatTensor<Self>;

    fn entropy(tau: FloatTensor<Self>, offsets: IntTensor<Self>, epsilon: f32) -> FloatTensor<Self>;

    fn divergence(
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
    fn composite(tau: CubeTensor, values: CubeTensor, offsets: CubeTensor) -> CubeTensor {
        let [tau, values] = [tau, values].map(into_contiguous);
        let (rays, channels) = (rays(&offsets), values.meta.shape()[1]);
        let out = empty(&tau, [rays, channels + 1]);
        let (count, dim) = threads(&tau, rays);
        kernels::composite_forward::launch(
            &out.client,
            count,
            dim,
            tau.into_tensor_arg(),
            values.into_tensor_arg(),
            offsets.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            channels,
        );
        out
    }

    fn entropy(tau: CubeTensor, offsets: CubeTensor, epsilon: f32) -> CubeTensor {
        let tau = into_contiguous(tau);
        let rays = rays(&offsets);
        let out = empty(&tau, [rays, 2]);
        let (count, dim) = threads(&tau, rays);
        kernels::entropy_forward::launch(
            &out.client,
            count,
            dim,
            tau.into_tensor_arg(),
            offsets.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            epsilon,
            MIN_ALPHA_SUM,
        );
        out
    }

    fn divergence(tau: CubeTensor, near: CubeTensor, offsets: CubeTensor, epsilon: f32) -> CubeTensor {
        let [tau, near] = [tau, near].map(into_contiguous);
        let rays = rays(&offsets);
        let out = empty(&tau, [rays]);
        let (count, dim) = threads(&tau, rays);
        kernels::divergence_forward::launch(
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

/// Gradients of an operation of `N` inputs, given these and the gradient of the output.
trait Pullback<const N: usize>: Clone + std::fmt::Debug + Send + 'static {
    fn pull(&self, inputs: [CubeTensor; N], offsets: CubeTensor, grad: CubeTensor) -> [CubeTensor; N];
}

#[derive(Clone, Debug)]
struct CompositePullback;

impl Pullback<2> for CompositePullback {
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
            channels,
        );
        [dtau, dvalues]
    }
}

#[derive(Clone, Debug)]
struct EntropyPullback {
    epsilon: f32,
}

impl Pullback<1> for EntropyPullback {
    fn pull(&self, [tau]: [CubeTensor; 1], offsets: CubeTensor, grad: CubeTensor) -> [CubeTensor; 1] {
        let (count, dim) = threads(&tau, rays(&offsets));
        let dtau = empty(&tau, tau.meta.shape().clone());
        kernels::entropy_backward::launch(
            &tau.client.clone(),
            count,
            dim,
            tau.into_tensor_arg(),
            offsets.into_tensor_arg(),
            grad.into_tensor_arg(),
            dtau.clone().into_tensor_arg(),
            self.epsilon,
            MIN_ALPHA_SUM,
        );
        [dtau]
    }
}

#[derive(Clone, Debug)]
struct DivergencePullback {
    epsilon: f32,
}

impl Pullback<2> for DivergencePullback {
    fn pull(&self, [tau, near]: [CubeTensor; 2], offsets: CubeTensor, grad: CubeTensor) -> [CubeTensor; 2] {
        let (count, dim) = threads(&tau, rays(&offsets));
        let [dtau, dnear] = [&tau, &near].map(|input| empty(input, input.meta.shape().clone()));
        kernels::divergence_backward::launch(
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
struct RayBackward<P, const N: usize>(std::marker::PhantomData<P>);

#[derive(Clone, Debug)]
struct Saved<P, const N: usize> {
    inputs: [CubeTensor; N],
    offsets: CubeTensor,
    pullback: P,
}

impl<P: Pullback<N>, const N: usize> Backward<CubeBackend, N> for RayBackward<P, N> {
    type State = Saved<P, N>;

    fn backward(self, ops: Ops<Self::State, N>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
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

fn tracked<C: CheckpointStrategy, P: Pullback<N>, const N: usize>(
    inputs: [Tracked<C>; N],
    offsets: CubeTensor,
    pullback: P,
    forward: impl FnOnce([CubeTensor; N], CubeTensor) -> CubeTensor,
) -> Tracked<C> {
    let guards = inputs.each_ref().map(|input| input.node());
    let inputs = inputs.map(|input| into_contiguous(input.into_primitive()));
    let output = forward(inputs.clone(), offsets.clone());
    match RayBackward::<P, N>(std::marker::PhantomData).prepare::<C>(guards).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(Saved { inputs, offsets, pullback }, output),
        OpsKind::UnTracked(prep) => prep.finish(output),
    }
}

impl<C: CheckpointStrategy> RayOps for Autodiff<CubeBackend, C> {
    fn composite(tau: Tracked<C>, values: Tracked<C>, offsets: CubeTensor) -> Tracked<C> {
        tracked::<C, _, 2>([tau, values], offsets, CompositePullback, |[tau, values], offsets| {
            CubeBackend::composite(tau, values, offsets)
        })
    }

    fn entropy(tau: Tracked<C>, offsets: CubeTensor, epsilon: f32) -> Tracked<C> {
        tracked::<C, _, 1>([tau], offsets, EntropyPullback { epsilon }, |[tau], offsets| {
            CubeBackend::entropy(tau, offsets, epsilon)
        })
    }

    fn divergence(tau: Tracked<C>, near: Tracked<C>, offsets: CubeTensor, epsilon: f32) -> Tracked<C> {
        tracked::<C, _, 2>([tau, near], offsets, DivergencePullback { epsilon }, |[tau, near], offsets| {
            CubeBackend::divergence(tau, near, offsets, epsilon)
        })
    }
}
