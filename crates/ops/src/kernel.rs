//! How a kernel over host slices becomes a differentiable Burn operation on the `flex` backend.
//!
//! A new operation implements [`Kernel`] and calls `apply`; dispatch, graph registration and gradient bookkeeping happen
//! here and in `graph.rs`, once.

use std::fmt::Debug;
use std::sync::{Arc, Mutex, PoisonError};

use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{DType, Tensor, TensorData};

use crate::graph::{self, Inputs, Operation};

/// A differentiable function of contiguous row-major `f32` arrays.
pub trait Kernel: Debug + Send + Sync + 'static {
    /// Shape of the output, given the shapes of the inputs.
    fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize>;

    /// Computes the output. If a backward pass will follow, `saved` is a buffer to keep numbers for it. It may hold those of
    /// an earlier pass: set its length first.
    fn forward(&self, inputs: &[&[f32]], saved: Option<&mut Vec<f32>>) -> Vec<f32>;

    /// Vector–Jacobian product: for each input that is `wanted`, the gradient of `⟨grad, output⟩` with respect to it.
    fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>>;
}

/// The arguments of a backward pass.
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

type Host = FloatTensor<Flex>;

#[backend_extension(Flex, Autodiff)]
trait HostOps: Backend {
    fn host(#[extension_type] inputs: Inputs<Self>, operation: HostOperation) -> FloatTensor<Self>;
}

impl HostOps for Flex {
    fn host(inputs: Inputs<Self>, operation: HostOperation) -> Host {
        graph::untracked(&operation, inputs)
    }
}

impl<C: CheckpointStrategy> HostOps for Autodiff<Flex, C> {
    fn host(inputs: Inputs<Self>, operation: HostOperation) -> FloatTensor<Self> {
        graph::tracked::<Flex, C, _>(operation, inputs)
    }
}

/// `kernel(inputs)` as a tensor of rank `D`.
pub(crate) fn apply<const D: usize>(kernel: impl Kernel, inputs: impl Into<Inputs<Dispatch>>) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as HostOps>::host(inputs.into(), HostOperation(Arc::new(kernel))))
}

/// A kernel on `flex` tensors.
#[derive(Clone, Debug)]
struct HostOperation(Arc<dyn Kernel>);

fn host(values: Vec<f32>, shape: Vec<usize>) -> Host {
    Host::from_data(TensorData::new(values, shape))
}

fn slice(tensor: &Host) -> &[f32] {
    tensor.as_slice::<f32>().expect("host kernels are given contiguous f32 tensors")
}

fn shape(tensor: &Host) -> Vec<usize> {
    tensor.shape().to_vec()
}

impl HostOperation {
    fn run(&self, inputs: &[Host], saved: Option<&mut Vec<f32>>) -> Host {
        let slices: Vec<&[f32]> = inputs.iter().map(slice).collect();
        let shapes: Vec<Vec<usize>> = inputs.iter().map(shape).collect();
        host(self.0.forward(&slices, saved), self.0.shape(&shapes))
    }
}

impl Operation<Flex> for HostOperation {
    type Kept = Arc<Kept>;

    fn prepare(tensor: Host) -> Host {
        use burn::backend::ops::FloatTensorOps;
        let tensor =
            if tensor.dtype() == DType::F32 { tensor } else { Flex::float_cast(tensor, burn::tensor::FloatDType::F32) };
        tensor.to_contiguous()
    }

    fn infer(&self, inputs: &[Host]) -> Host {
        self.run(inputs, None)
    }

    fn forward(&self, inputs: &[Host]) -> (Host, Arc<Kept>) {
        let mut kept = Kept::new();
        let output = self.run(inputs, Some(&mut kept.0));
        (output, Arc::new(kept))
    }

    fn backward(
        &self,
        inputs: &[Host],
        output: Host,
        kept: Arc<Kept>,
        grad: Host,
        wanted: &[bool],
    ) -> Vec<Option<Host>> {
        let slices: Vec<&[f32]> = inputs.iter().map(slice).collect();
        let pass = Pass { inputs: &slices, output: slice(&output), saved: &kept.0, grad: slice(&grad) };
        let results = self.0.backward(pass, wanted).into_iter().zip(inputs);
        results.map(|(result, input)| result.map(|values| host(values, shape(input)))).collect()
    }
}

/// Numbers that a forward pass keeps for the backward one.
///
/// Buffers are reused by later passes: for tens of megabytes in every step, having the system map and clear pages takes
/// longer than filling them.
#[derive(Debug)]
struct Kept(Vec<f32>);

/// Most buffers that are kept for another pass.
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
