//! Kernels for GPUs, written in CubeCL: compiled for the device at hand, be it through WGSL, SPIR-V or CUDA.
//!
//! Kernels index numbers by `row * columns + column`. CUDA and HIP pad the rows of tensors unless asked not to, so every
//! kernel reads and writes through [`arg`], which insists on dense rows.

/// Launches a kernel with one thread for each of `count` things: tensors first, then scalars.
macro_rules! launch {
    ($kernel:expr, $count:expr; $like:expr $(, $tensor:expr)*; $($scalar:expr),*) => {{
        let like: &burn_cubecl::tensor::CubeTensor = $like;
        let (count, dim) = $crate::cube::threads(like, $count);
        $kernel(&like.client, count, dim, $crate::cube::arg(like), $($crate::cube::arg($tensor),)* $($scalar),*)
    }};
}

mod activation;
mod adam;
mod dense;
mod encode;
mod gemm;
mod means;
mod outputs;
mod parameters;
mod radiance;
mod random;
mod rays;
mod sampling;
mod tables;
mod together;
mod unit_box;
mod variation;

use std::collections::VecDeque;
use std::fmt::Debug;
use std::sync::{Arc, Mutex, PoisonError};

use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, DispatchTensorKind, backend_extension};
use burn::cubecl::calculate_cube_count_elemwise;
use burn::cubecl::prelude::*;
use burn::tensor::{DType, Shape, Tensor, TensorData};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric::{empty_device_contiguous_dtype, zeros_client};
use burn_cubecl::tensor::CubeTensor;

pub(crate) use adam::{adam_together, finite_after};
pub(crate) use dense::{dense, has_tf32};
pub(crate) use encode::{frequency, integrated};
pub(crate) use means::{MOST_SCALARS, Summand, sum, weighted_sum};
pub(crate) use radiance::radiance;
pub(crate) use rays::{composite, divergence, entropy, points, spread};
pub(crate) use sampling::{importance, intervals, march, resample, stratified};
pub(crate) use tables::{features, network};
pub(crate) use together::together;
pub(crate) use unit_box::unit_box;
pub(crate) use variation::variation;

use crate::graph::{self, Inputs, Operation};
use crate::traffic::count_upload;

/// A differentiable function of dense `f32` tensors on a GPU.
trait CubeKernel: Debug + Send + Sync + 'static {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor;

    /// The same with what the backward pass needs beside inputs and output.
    fn forward_keeping(&self, inputs: &[CubeTensor]) -> (CubeTensor, Vec<CubeTensor>) {
        (self.forward(inputs), Vec::new())
    }

    /// For each input that is `wanted`, and perhaps for others, the gradient of ⟨`grad`, output⟩ with respect to it.
    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>>;
}

/// The arguments of a backward pass.
struct Pass<'a> {
    inputs: &'a [CubeTensor],
    output: &'a CubeTensor,
    kept: &'a [CubeTensor],
    grad: &'a CubeTensor,
    wanted: &'a [bool],
}

#[backend_extension(Cube, Autodiff)]
trait CubeOps: Backend {
    fn cube(#[extension_type] inputs: Inputs<Self>, operation: CubeOperation) -> FloatTensor<Self>;
}

impl CubeOps for CubeBackend {
    fn cube(inputs: Inputs<Self>, operation: CubeOperation) -> CubeTensor {
        graph::untracked(&operation, inputs)
    }
}

impl<C: CheckpointStrategy> CubeOps for Autodiff<CubeBackend, C> {
    fn cube(inputs: Inputs<Self>, operation: CubeOperation) -> FloatTensor<Self> {
        graph::tracked::<CubeBackend, C, _>(operation, inputs)
    }
}

/// `kernel(inputs)` as a tensor of rank `D`.
fn apply<const D: usize>(kernel: impl CubeKernel, inputs: impl Into<Inputs<Dispatch>>) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as CubeOps>::cube(inputs.into(), CubeOperation(Arc::new(kernel))))
}

/// What a tensor is made of that is in no graph.
fn untracked<const D: usize>(tensor: Tensor<D>) -> CubeTensor {
    match tensor.into_dispatch().kind {
        DispatchTensorKind::Cube(tensor) => into_contiguous(tensor.float()),
        other => unreachable!("{other:?} is no tensor of a GPU without a graph"),
    }
}

/// A kernel on tensors of a GPU.
#[derive(Clone, Debug)]
struct CubeOperation(Arc<dyn CubeKernel>);

impl Operation<CubeBackend> for CubeOperation {
    type Kept = Vec<CubeTensor>;

    fn prepare(tensor: CubeTensor) -> CubeTensor {
        into_contiguous(tensor)
    }

    fn infer(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.0.forward(inputs)
    }

    fn forward(&self, inputs: &[CubeTensor]) -> (CubeTensor, Vec<CubeTensor>) {
        self.0.forward_keeping(inputs)
    }

    fn backward(
        &self,
        inputs: &[CubeTensor],
        output: CubeTensor,
        kept: Vec<CubeTensor>,
        grad: CubeTensor,
        wanted: &[bool],
    ) -> Vec<Option<CubeTensor>> {
        self.0.backward(Pass { inputs, output: &output, kept: &kept, grad: &grad, wanted })
    }
}

/// One thread for each of `count` things.
fn threads(like: &CubeTensor, count: usize) -> (CubeCount, CubeDim) {
    let dim = CubeDim::new(&like.client, count);
    (calculate_cube_count_elemwise(&like.client, count, dim), dim)
}

/// A tensor as a kernel's argument.
///
/// # Panics
/// If there is something between its rows, which kernels would take for numbers of the next row.
fn arg(tensor: &CubeTensor) -> TensorArg {
    assert!(tensor.is_contiguous(), "kernels index dense rows");
    tensor.clone().into_tensor_arg()
}

/// Dense memory with whatever is in it.
fn empty<S: Into<Shape>>(like: &CubeTensor, shape: S) -> CubeTensor {
    empty_device_contiguous_dtype(like.client.clone(), like.device.clone(), shape.into(), DType::F32)
}

/// Memory of the shape of `like`, dense.
fn empty_like(like: &CubeTensor) -> CubeTensor {
    empty(like, like.meta.shape().clone())
}

/// Dense zeros.
fn zeros<S: Into<Shape>>(like: &CubeTensor, shape: S) -> CubeTensor {
    let shape = shape.into();
    // A single row is never padded.
    let row = zeros_client(like.client.clone(), like.device.clone(), [shape.num_elements()].into(), DType::F32);
    burn_cubecl::ops::reshape(row, shape)
}

/// Numbers moved to the device of `like`, and a zero more: a buffer cannot be empty. The last few stay there, as the same
/// weights are asked for again and again.
fn numbers(values: &[f32], like: &CubeTensor) -> CubeTensor {
    const KEPT: usize = 8;
    static LAST: Mutex<VecDeque<(Vec<f32>, CubeTensor)>> = Mutex::new(VecDeque::new());
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, kept)) = last.iter().find(|(of, kept)| of == values && kept.device == like.device) {
        return kept.clone();
    }
    let padded: Vec<f32> = values.iter().copied().chain([0.0]).collect();
    let count = padded.len();
    count_upload(size_of_val(padded.as_slice()));
    let moved = CubeBackend::float_from_data(TensorData::new(padded, [count]), &like.device);
    last.truncate(KEPT - 1);
    last.push_front((values.to_vec(), moved.clone()));
    moved
}
