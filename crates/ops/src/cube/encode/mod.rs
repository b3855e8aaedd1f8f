//! Encodings of positions: what is moved to the device is the points and not the many numbers that they become.

mod kernels;

use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, backend_extension};
use burn::tensor::{Device, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;

pub(super) use self::kernels::{Angle, wave};
use super::{empty, threads, upload};
use crate::frequency::encoded_width;
use crate::integrated::integrated_width;

/// [`frequency_encode`](crate::frequency_encode).
pub(crate) fn frequency(points: &[f32], dims: usize, octaves: usize, window: &[f32], device: &Device) -> Tensor<2> {
    let [points, window] = [upload(points, dims, device), weights(octaves, window, device)];
    Tensor::from_dispatch(<Dispatch as EncodeOps>::frequency(points.into_dispatch(), window.into_dispatch(), octaves))
}

/// [`integrated_encode`](crate::integrated_encode).
pub(crate) fn integrated(
    means: &[f32],
    variances: &[f32],
    octaves: usize,
    window: &[f32],
    device: &Device,
) -> Tensor<2> {
    let [means, variances] = [means, variances].map(|rows| upload(rows, 3, device));
    let window = weights(octaves, window, device);
    Tensor::from_dispatch(<Dispatch as EncodeOps>::integrated(
        means.into_dispatch(),
        variances.into_dispatch(),
        window.into_dispatch(),
        octaves,
    ))
}

/// One weight an octave, and one more: a buffer cannot be empty.
fn weights(octaves: usize, window: &[f32], device: &Device) -> Tensor<2> {
    let weights: Vec<f32> = (0..=octaves).map(|octave| window.get(octave).copied().unwrap_or(1.0)).collect();
    upload(&weights, 1, device)
}

#[backend_extension(Cube, Autodiff)]
trait EncodeOps: Backend {
    fn frequency(points: FloatTensor<Self>, window: FloatTensor<Self>, octaves: usize) -> FloatTensor<Self>;

    fn integrated(
        means: FloatTensor<Self>,
        variances: FloatTensor<Self>,
        window: FloatTensor<Self>,
        octaves: usize,
    ) -> FloatTensor<Self>;
}

impl EncodeOps for CubeBackend {
    fn frequency(points: CubeTensor, window: CubeTensor, octaves: usize) -> CubeTensor {
        let [points, window] = [points, window].map(into_contiguous);
        let [rows, dims] = points.meta.shape().dims();
        let out = empty(&points, [rows, encoded_width(dims, octaves)]);
        let (count, dim) = threads(&points, rows * dims);
        kernels::frequency::launch(
            &out.client,
            count,
            dim,
            points.into_tensor_arg(),
            window.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            octaves,
        );
        out
    }

    fn integrated(means: CubeTensor, variances: CubeTensor, window: CubeTensor, octaves: usize) -> CubeTensor {
        let [means, variances, window] = [means, variances, window].map(into_contiguous);
        let [rows, dims] = means.meta.shape().dims();
        let out = empty(&means, [rows, integrated_width(octaves)]);
        let (count, dim) = threads(&means, rows * dims);
        kernels::integrated::launch(
            &out.client,
            count,
            dim,
            means.into_tensor_arg(),
            variances.into_tensor_arg(),
            window.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            octaves,
        );
        out
    }
}

/// Positions are no parameters: nothing is tracked.
impl<C: CheckpointStrategy> EncodeOps for Autodiff<CubeBackend, C> {
    fn frequency(points: FloatTensor<Self>, window: FloatTensor<Self>, octaves: usize) -> FloatTensor<Self> {
        FloatTensor::<Self>::new(CubeBackend::frequency(points.into_primitive(), window.into_primitive(), octaves))
    }

    fn integrated(
        means: FloatTensor<Self>,
        variances: FloatTensor<Self>,
        window: FloatTensor<Self>,
        octaves: usize,
    ) -> FloatTensor<Self> {
        let [means, variances, window] = [means, variances, window].map(|tensor| tensor.into_primitive());
        FloatTensor::<Self>::new(CubeBackend::integrated(means, variances, window, octaves))
    }
}
