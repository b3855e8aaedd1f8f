//! How a kernel over host slices becomes a differentiable Burn operation on the `flex` backend.
//!
//! A new operation implements [`Kernel`] and calls `apply1` or `apply2`; dispatch, graph registration and
//! gradient bookkeeping happen here, once.

use std::fmt::Debug;
use std::sync::{Arc, Mutex, PoisonError};

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, DispatchDevice, Flex, TensorMetadata, backend_extension};
use burn::tensor::{DType, Device, Tensor, TensorData};

/// A differentiable function of contiguous row-major `f32` arrays.
pub trait Kernel: Debug + Send + Sync + 'static {
    /// Shape of the output, given the shapes of the inputs.
    fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize>;

    /// Computes the output. If there will be a backward pass, `saved` is there to keep numbers for it; it may hold those of
    /// an earlier pass, so that its length has to be set.
    fn forward(&self, inputs: &[&[f32]], saved: Option<&mut Vec<f32>>) -> Vec<f32>;

    /// Vector–Jacobian product: for each input that is `wanted`, the gradient of `⟨grad, output⟩` with respect to it.
    fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>>;
}

/// What a backward pass has to go by.
#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    /// The inputs of the forward pass.
    pub inputs: &'a [&'a [f32]],
    /// Its output.
    pub output: &'a [f32],
    /// What it kept.
    pub saved: &'a [f32],
    /// The gradient with respect to the output.
    pub grad: &'a [f32],
}

type Shared = Arc<dyn Kernel>;
type Host = FloatTensor<Flex>;

/// Extension point of the `flex` backend: run a [`Kernel`] of one or two inputs.
#[backend_extension(Flex, Autodiff)]
trait HostOps: Backend {
    fn host1(a: FloatTensor<Self>, kernel: Shared) -> FloatTensor<Self>;
    fn host2(a: FloatTensor<Self>, b: FloatTensor<Self>, kernel: Shared) -> FloatTensor<Self>;
}

/// Whether `device` is `flex` (with or without autodiff) in single precision.
pub(crate) fn is_flex(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Flex(_))
}

/// `kernel(a)` as a tensor of rank `D`.
pub(crate) fn apply1<const A: usize, const D: usize>(kernel: impl Kernel, a: Tensor<A>) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as HostOps>::host1(a.into_dispatch(), Arc::new(kernel)))
}

/// `kernel(a, b)` as a tensor of rank `D`.
pub(crate) fn apply2<const A: usize, const B: usize, const D: usize>(
    kernel: impl Kernel,
    a: Tensor<A>,
    b: Tensor<B>,
) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as HostOps>::host2(a.into_dispatch(), b.into_dispatch(), Arc::new(kernel)))
}

fn host(values: Vec<f32>, shape: Vec<usize>) -> Host {
    Host::from_data(TensorData::new(values, shape))
}

fn slice(tensor: &Host) -> &[f32] {
    tensor.as_slice::<f32>().expect("host kernels are given contiguous f32 tensors")
}

fn prepare(tensor: Host) -> Host {
    use burn::backend::ops::FloatTensorOps;
    let tensor =
        if tensor.dtype() == DType::F32 { tensor } else { Flex::float_cast(tensor, burn::tensor::FloatDType::F32) };
    tensor.to_contiguous()
}

fn forward(inputs: &[Host], kernel: &dyn Kernel, saved: Option<&mut Vec<f32>>) -> Host {
    let shapes: Vec<Vec<usize>> = inputs.iter().map(|t| t.shape().to_vec()).collect();
    let slices: Vec<&[f32]> = inputs.iter().map(slice).collect();
    host(kernel.forward(&slices, saved), kernel.shape(&shapes))
}

impl HostOps for Flex {
    fn host1(a: Host, kernel: Shared) -> Host {
        forward(&[prepare(a)], kernel.as_ref(), None)
    }

    fn host2(a: Host, b: Host, kernel: Shared) -> Host {
        forward(&[prepare(a), prepare(b)], kernel.as_ref(), None)
    }
}

/// Numbers that a forward pass keeps for the backward one.
///
/// Their memory is handed on to later passes: for tens of megabytes in every step, having the system map and clear pages
/// takes longer than filling them.
#[derive(Debug)]
struct Kept(Vec<f32>);

/// Most buffers that wait for another pass.
const SPARE_BUFFERS: usize = 4;
static SPARE: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());

impl Kept {
    fn new() -> Self {
        Self(SPARE.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default())
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        let mut spare = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
        if spare.len() < SPARE_BUFFERS {
            spare.push(std::mem::take(&mut self.0));
        }
    }
}

#[derive(Debug)]
struct HostBackward<const N: usize>;

#[derive(Clone, Debug)]
struct Saved<const N: usize> {
    inputs: [Host; N],
    output: Host,
    kept: Arc<Kept>,
    kernel: Shared,
}

impl<const N: usize> Backward<Flex, N> for HostBackward<N> {
    type State = Saved<N>;

    fn backward(self, ops: Ops<Self::State, N>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let Saved { inputs, output, kept, kernel } = ops.state;
        let grad = prepare(grads.consume::<Flex>(&ops.node));
        let wanted = ops.parents.each_ref().map(Option::is_some);
        let slices = inputs.each_ref().map(slice);
        let pass = Pass { inputs: &slices, output: slice(&output), saved: &kept.0, grad: slice(&grad) };
        let results = kernel.backward(pass, &wanted);
        for ((parent, input), result) in ops.parents.into_iter().zip(&inputs).zip(results) {
            if let (Some(node), Some(values)) = (parent, result) {
                grads.register::<Flex>(node.id, host(values, input.shape().to_vec()));
            }
        }
    }
}

fn tracked<const N: usize, C: CheckpointStrategy>(
    inputs: [FloatTensor<Autodiff<Flex, C>>; N],
    kernel: Shared,
) -> FloatTensor<Autodiff<Flex, C>> {
    let guards = inputs.each_ref().map(|input| input.node());
    let inputs = inputs.map(|input| prepare(input.into_primitive()));
    match HostBackward::<N>.prepare::<C>(guards).compute_bound().stateful() {
        OpsKind::Tracked(prep) => {
            let mut kept = Kept::new();
            let output = forward(&inputs, kernel.as_ref(), Some(&mut kept.0));
            prep.finish(Saved { inputs, output: output.clone(), kept: Arc::new(kept), kernel }, output)
        }
        OpsKind::UnTracked(prep) => prep.finish(forward(&inputs, kernel.as_ref(), None)),
    }
}

impl<C: CheckpointStrategy> HostOps for Autodiff<Flex, C> {
    fn host1(a: FloatTensor<Self>, kernel: Shared) -> FloatTensor<Self> {
        tracked::<1, C>([a], kernel)
    }

    fn host2(a: FloatTensor<Self>, b: FloatTensor<Self>, kernel: Shared) -> FloatTensor<Self> {
        tracked::<2, C>([a, b], kernel)
    }
}
