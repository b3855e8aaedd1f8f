//! Encodings of positions: what is moved to the device is the points and not the many numbers that they become.

mod kernels;

use std::f64::consts::FRAC_PI_2;

use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, backend_extension};
use burn::tensor::{Device, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;
use rayon::prelude::*;

pub(super) use self::kernels::{Angle, wave};
use super::{empty, threads, upload};
use crate::frequency::encoded_width;
use crate::integrated::integrated_width;

/// [`frequency_encode`](crate::frequency_encode).
pub(crate) fn frequency(points: &[f32], dims: usize, frequencies: usize, window: &[f32], device: &Device) -> Tensor<2> {
    let (angles, points) = (upload(&angles(points), 2 * dims, device), upload(points, dims, device));
    Tensor::from_dispatch(<Dispatch as EncodeOps>::frequency(
        points.into_dispatch(),
        angles.into_dispatch(),
        weights(frequencies, window, device).into_dispatch(),
        frequencies,
    ))
}

/// [`integrated_encode`](crate::integrated_encode).
pub(crate) fn integrated(
    means: &[f32],
    variances: &[f32],
    frequencies: usize,
    window: &[f32],
    device: &Device,
) -> Tensor<2> {
    let (angles, variances) = (upload(&angles(means), 6, device), upload(variances, 3, device));
    Tensor::from_dispatch(<Dispatch as EncodeOps>::integrated(
        angles.into_dispatch(),
        variances.into_dispatch(),
        weights(frequencies, window, device).into_dispatch(),
        frequencies,
    ))
}

/// Each number as an angle in quarter turns, between −2 and 2, in two parts: a GPU's `f32` would not keep enough digits
/// of it for the high frequencies. A whole turn less is a whole number of turns less in every frequency.
fn angles(points: &[f32]) -> Vec<f32> {
    // Above this the quotient's digits before the point cost too many behind it.
    const NEAR: f64 = 1e4;
    let parts = |x: &f32| {
        let x = f64::from(*x);
        let x = if x.abs() < NEAR { x } else { x.sin().atan2(x.cos()) };
        let quarters = x / FRAC_PI_2;
        let rest = quarters - 4.0 * (quarters / 4.0).round();
        let coarse = rest as f32;
        [coarse, (rest - f64::from(coarse)) as f32]
    };
    points.par_iter().flat_map_iter(parts).collect()
}

/// One weight per frequency, and one more: a buffer cannot be empty.
fn weights(frequencies: usize, window: &[f32], device: &Device) -> Tensor<2> {
    let weights: Vec<f32> = (0..=frequencies).map(|frequency| window.get(frequency).copied().unwrap_or(1.0)).collect();
    upload(&weights, 1, device)
}

#[backend_extension(Cube, Autodiff)]
trait EncodeOps: Backend {
    fn frequency(
        points: FloatTensor<Self>,
        angles: FloatTensor<Self>,
        window: FloatTensor<Self>,
        frequencies: usize,
    ) -> FloatTensor<Self>;

    fn integrated(
        angles: FloatTensor<Self>,
        variances: FloatTensor<Self>,
        window: FloatTensor<Self>,
        frequencies: usize,
    ) -> FloatTensor<Self>;
}

impl EncodeOps for CubeBackend {
    fn frequency(points: CubeTensor, angles: CubeTensor, window: CubeTensor, frequencies: usize) -> CubeTensor {
        let [points, angles, window] = [points, angles, window].map(into_contiguous);
        let [rows, dims] = points.meta.shape().dims();
        let out = empty(&points, [rows, encoded_width(dims, frequencies)]);
        let (count, dim) = threads(&points, rows * dims);
        kernels::frequency::launch(
            &out.client,
            count,
            dim,
            points.into_tensor_arg(),
            angles.into_tensor_arg(),
            window.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            frequencies,
        );
        out
    }

    fn integrated(angles: CubeTensor, variances: CubeTensor, window: CubeTensor, frequencies: usize) -> CubeTensor {
        let [angles, variances, window] = [angles, variances, window].map(into_contiguous);
        let [rows, dims] = variances.meta.shape().dims();
        let out = empty(&angles, [rows, integrated_width(frequencies)]);
        let (count, dim) = threads(&angles, rows * dims);
        kernels::integrated::launch(
            &out.client,
            count,
            dim,
            angles.into_tensor_arg(),
            variances.into_tensor_arg(),
            window.into_tensor_arg(),
            out.clone().into_tensor_arg(),
            frequencies,
        );
        out
    }
}

/// Positions are no parameters: nothing is tracked.
impl<C: CheckpointStrategy> EncodeOps for Autodiff<CubeBackend, C> {
    fn frequency(
        points: FloatTensor<Self>,
        angles: FloatTensor<Self>,
        window: FloatTensor<Self>,
        frequencies: usize,
    ) -> FloatTensor<Self> {
        let [points, angles, window] = [points, angles, window].map(|tensor| tensor.into_primitive());
        FloatTensor::<Self>::new(CubeBackend::frequency(points, angles, window, frequencies))
    }

    fn integrated(
        angles: FloatTensor<Self>,
        variances: FloatTensor<Self>,
        window: FloatTensor<Self>,
        frequencies: usize,
    ) -> FloatTensor<Self> {
        let [angles, variances, window] = [angles, variances, window].map(|tensor| tensor.into_primitive());
        FloatTensor::<Self>::new(CubeBackend::integrated(angles, variances, window, frequencies))
    }
}
