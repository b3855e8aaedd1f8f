//! Base of the kernels for CPUs: functions of slices that become differentiable operations of the `flex` backend.
//!
//! A new operation implements [`Kernel`] and calls [`apply`], or [`rays::RayKernel`] and [`rays::apply`] if each of its rows of
//! output depends on the samples of one ray. Inner loops are a [`simd::Job`], which is compiled for several instruction sets.

pub(crate) mod buffers;
pub(crate) mod distribution;
pub(crate) mod matmul;
pub(crate) mod numeric;
pub(crate) mod rays;
pub(crate) mod simd;

use std::fmt::Debug;
use std::sync::Arc;

use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{DispatchTensor, Flex, TensorMetadata};
use burn::tensor::{DType, FloatDType, Tensor, TensorData};

use self::buffers::Scratch;
use crate::graph::{self, KernelBackend, Operation};

/// Number of partial sums of the gradients of a network: fixed, so that the result does not depend on the number of threads.
pub(crate) const PARTIAL_SUMS: usize = 16;

/// Differentiable function of contiguous row-major `f32` arrays.
pub(crate) trait Kernel: Debug + Send + Sync + 'static {
    /// Computes the output.
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32>;

    /// Computes the output, and the values that the backward pass needs in addition to inputs and output; by default none.
    fn forward_saving(&self, inputs: &[&[f32]]) -> (Vec<f32>, Scratch) {
        (self.forward(inputs), Scratch::default())
    }

    /// Computes the vector–Jacobian product: the gradient of ⟨`grad`, output⟩ with respect to each input that is `wanted`, and
    /// perhaps to others. Inputs beyond the end of the result have no gradient.
    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>>;
}

/// Arguments of a backward pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass<'a> {
    /// Inputs of the forward pass.
    pub(crate) inputs: &'a [&'a [f32]],
    /// Output of the forward pass.
    pub(crate) output: &'a [f32],
    /// Values that the forward pass kept.
    pub(crate) saved: &'a [f32],
    /// Gradient with respect to the output.
    pub(crate) grad: &'a [f32],
    /// Whether the gradient with respect to each input is used.
    pub(crate) wanted: &'a [bool],
}

/// Evaluates `kernel(inputs)` as a tensor of `shape`.
pub(crate) fn apply<const D: usize>(
    kernel: impl Kernel,
    shape: [usize; D],
    inputs: impl IntoIterator<Item = DispatchTensor>,
) -> Tensor<D> {
    graph::evaluate::<Flex, D>(Arc::new(HostOperation { kernel, shape: shape.to_vec() }), inputs)
}

#[derive(Debug)]
struct HostOperation<K> {
    kernel: K,
    shape: Vec<usize>,
}

type Host = FloatTensor<Flex>;

fn tensor(values: Vec<f32>, shape: Vec<usize>) -> Host {
    Host::from_data(TensorData::new(values, shape))
}

fn slice(tensor: &Host) -> &[f32] {
    tensor.as_slice::<f32>().expect("host kernels are given contiguous f32 tensors")
}

fn slices(tensors: &[Host]) -> Vec<&[f32]> {
    tensors.iter().map(slice).collect()
}

impl KernelBackend for Flex {
    type Kept = Arc<Scratch>;

    fn prepare(tensor: Host) -> Host {
        let tensor = if tensor.dtype() == DType::F32 { tensor } else { Self::float_cast(tensor, FloatDType::F32) };
        tensor.to_contiguous()
    }
}

impl<K: Kernel> Operation<Flex> for HostOperation<K> {
    fn forward(&self, inputs: &[Host]) -> Host {
        tensor(self.kernel.forward(&slices(inputs)), self.shape.clone())
    }

    fn forward_keeping(&self, inputs: &[Host]) -> (Host, Arc<Scratch>) {
        let (output, saved) = self.kernel.forward_saving(&slices(inputs));
        (tensor(output, self.shape.clone()), Arc::new(saved))
    }

    fn backward(&self, pass: graph::BackwardPass<'_, Flex>) -> Vec<Option<Host>> {
        let slices = slices(pass.inputs);
        let (output, grad) = (slice(pass.output), slice(pass.grad));
        let gradients =
            self.kernel.backward(Pass { inputs: &slices, output, saved: pass.kept, grad, wanted: pass.wanted });
        let shaped = |(gradient, input): (Option<Vec<f32>>, &Host)| Some(tensor(gradient?, input.shape().to_vec()));
        gradients.into_iter().zip(pass.inputs).map(shaped).collect()
    }
}
