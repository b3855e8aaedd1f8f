//! Base of the kernels for GPUs, which are written in CubeCL and compiled for the device at hand, through WGSL, SPIR-V or CUDA.
//!
//! Kernels index values by `row * columns + column`. CUDA and HIP pad the rows of tensors unless asked not to, so every
//! kernel reads and writes through [`arg`], which requires dense rows.

/// Launches a kernel with one thread for each of `count` items. Arguments are tensors, then scalars.
macro_rules! launch {
    ($kernel:expr, $count:expr; $like:expr $(, $tensor:expr)*; $($scalar:expr),*) => {{
        let like: &burn_cubecl::tensor::CubeTensor = $like;
        let (count, dim) = $crate::cube::threads(like, $count);
        $kernel(&like.client, count, dim, $crate::cube::arg(like), $($crate::cube::arg($tensor),)* $($scalar),*)
    }};
}
pub(crate) use launch;

pub(crate) mod buffers;
pub(crate) mod random;
pub(crate) mod rays;

use std::collections::VecDeque;
use std::fmt::{self, Debug, Formatter};
use std::sync::{Arc, Mutex, PoisonError};

use burn::backend::ops::FloatTensorOps;
use burn::backend::{DispatchTensor, DispatchTensorKind};
use burn::cubecl::calculate_cube_count_elemwise;
use burn::cubecl::prelude::*;
use burn::tensor::{DType, Shape, Tensor, TensorData};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric::empty_device_contiguous_dtype;
use burn_cubecl::tensor::CubeTensor;

pub(crate) use crate::graph::Operation;
use crate::graph::{self, KernelBackend};
use crate::traffic::count_upload;

pub(crate) type Pass<'a> = graph::BackwardPass<'a, CubeBackend>;

impl KernelBackend for CubeBackend {
    type Kept = ();

    fn prepare(tensor: CubeTensor) -> CubeTensor {
        into_contiguous(tensor)
    }
}

/// Evaluates `kernel(inputs)` as a tensor of rank `D`.
pub(crate) fn apply<const D: usize>(
    kernel: impl Operation<CubeBackend> + 'static,
    inputs: impl IntoIterator<Item = DispatchTensor>,
) -> Tensor<D> {
    graph::evaluate::<CubeBackend, D>(Arc::new(kernel), inputs)
}

/// Evaluates `compute(inputs)`, which has no gradient, as a tensor of rank `D`.
pub(crate) fn apply_without_gradient<const N: usize, const D: usize>(
    inputs: [DispatchTensor; N],
    compute: impl Fn(&[CubeTensor; N]) -> CubeTensor + Send + Sync + 'static,
) -> Tensor<D> {
    apply(WithoutGradient::<_, N>(compute), inputs)
}

struct WithoutGradient<F, const N: usize>(F);

impl<F, const N: usize> Debug for WithoutGradient<F, N> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        formatter.write_str("WithoutGradient")
    }
}

impl<F, const N: usize> Operation<CubeBackend> for WithoutGradient<F, N>
where
    F: Fn(&[CubeTensor; N]) -> CubeTensor + Send + Sync,
{
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        (self.0)(<&[CubeTensor; N]>::try_from(inputs).expect("an operation runs on all of its inputs"))
    }

    fn backward(&self, _pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        Vec::new()
    }
}

/// Returns the dense primitive of a GPU tensor that is in no autodiff graph.
pub(crate) fn untracked<const D: usize>(tensor: Tensor<D>) -> CubeTensor {
    match tensor.into_dispatch().kind {
        DispatchTensorKind::Cube(tensor) => into_contiguous(tensor.float()),
        other => unreachable!("{other:?} is no tensor of a GPU without a graph"),
    }
}

/// Returns the launch size of one thread for each of `count` items.
pub(crate) fn threads(like: &CubeTensor, count: usize) -> (CubeCount, CubeDim) {
    let dim = CubeDim::new(&like.client, count);
    (calculate_cube_count_elemwise(&like.client, count, dim), dim)
}

/// Converts a tensor without padding, which kernels would read as values of the next row, to a kernel's argument.
pub(crate) fn arg(tensor: &CubeTensor) -> TensorArg {
    assert!(tensor.is_contiguous(), "kernels index dense rows");
    tensor.clone().into_tensor_arg()
}

/// Allocates dense memory, uninitialized.
pub(crate) fn empty<S: Into<Shape>>(like: &CubeTensor, shape: S) -> CubeTensor {
    empty_device_contiguous_dtype(like.client.clone(), like.device.clone(), shape.into(), DType::F32)
}

/// Allocates dense memory of the shape of `like`, uninitialized.
pub(crate) fn empty_like(like: &CubeTensor) -> CubeTensor {
    empty(like, like.meta.shape().clone())
}

/// Uploads values to the device of `like`, followed by a zero, since a buffer cannot be empty. The last few uploads are cached,
/// because the same weights are asked for again and again.
pub(crate) fn uploaded(values: &[f32], like: &CubeTensor) -> CubeTensor {
    const CACHED: usize = 8;
    static CACHE: Mutex<VecDeque<(Vec<f32>, CubeTensor)>> = Mutex::new(VecDeque::new());
    let mut cache = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, cached)) = cache.iter().find(|(of, cached)| of == values && cached.device == like.device) {
        return cached.clone();
    }
    let padded: Vec<f32> = values.iter().copied().chain([0.0]).collect();
    let count = padded.len();
    count_upload(size_of_val(padded.as_slice()));
    let tensor = CubeBackend::float_from_data(TensorData::new(padded, [count]), &like.device);
    cache.truncate(CACHED - 1);
    cache.push_front((values.to_vec(), tensor.clone()));
    tensor
}
