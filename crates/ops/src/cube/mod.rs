//! Kernels for GPUs, written in CubeCL: compiled for the device at hand, be it through WGSL, SPIR-V or CUDA.

mod encode;
mod rays;
mod tables;

use burn::backend::DispatchDevice;
use burn::cubecl::calculate_cube_count_elemwise;
use burn::cubecl::prelude::*;
use burn::tensor::{DType, Device, Shape, Tensor, TensorData};
use burn_cubecl::ops::numeric::{empty_device_dtype, zeros_client};
use burn_cubecl::tensor::CubeTensor;

pub(crate) use encode::{frequency, integrated};
pub(crate) use rays::{composite, divergence, entropy};
pub(crate) use tables::features;

/// Whether tensors on `device` are served by these kernels.
pub(crate) fn serves(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Cube(_))
}

/// One thread for each of `count` things.
fn threads(like: &CubeTensor, count: usize) -> (CubeCount, CubeDim) {
    let dim = CubeDim::new(&like.client, count);
    (calculate_cube_count_elemwise(&like.client, count, dim), dim)
}

fn empty(like: &CubeTensor, shape: impl Into<Shape>) -> CubeTensor {
    empty_device_dtype(like.client.clone(), like.device.clone(), shape.into(), DType::F32)
}

fn zeros(like: &CubeTensor, shape: impl Into<Shape>) -> CubeTensor {
    zeros_client(like.client.clone(), like.device.clone(), shape.into(), DType::F32)
}

/// Rows of `width` numbers, moved to `device`.
fn upload(rows: &[f32], width: usize, device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(rows.to_vec(), [rows.len() / width, width]), device)
}
