//! Positional encodings: of points (NeRF, Eq. 4), and integrated over Gaussians (mip-NeRF, Sec. 3.1).

#[cfg(feature = "cube")]
pub(crate) mod gpu;
#[cfg(feature = "flex")]
mod host;

use burn::tensor::{FloatDType, Tensor};

use crate::dispatch::dispatch;
use crate::plain::working_dtype;

/// Encodes points with sines and cosines of doubling frequency.
///
/// γ(x) = (x, sin 2⁰x, cos 2⁰x, …, sin 2^(L−1)x, cos 2^(L−1)x), with `x` itself and without a factor π, as in the released
/// code: `[M, D]` → `[M, D·(1 + 2·L)]`, each frequency's sines before its cosines. `window[l]` scales frequency `l`
/// (FreeNeRF's annealing); a frequency beyond its length has weight 1. Differentiable in `points`:
/// `∂/∂x sin 2ˡx = 2ˡ cos 2ˡx`.
///
/// Finite for every finite point. On GPUs the error is below 1e-6 while 2^(L−1)|x| < 10⁷, and unbounded far beyond.
pub fn frequency_encode(points: Tensor<2>, frequencies: usize, window: &[f32]) -> Tensor<2> {
    encode(points, None, weights(frequencies, window))
}

/// Computes the mean of the positional encoding over axis-aligned Gaussians in space (mip-NeRF, Eq. 13–14).
///
/// γ(μ, σ²) = (…, sin(2ˡμ) exp(−½ 4ˡσ²), cos(2ˡμ) exp(−½ 4ˡσ²), …) for each frequency l and axis, since E[sin x] of
/// x ~ N(μ, σ²) is sin μ · exp(−σ²/2): frequencies that vary within the Gaussian vanish. Columns are in the order of
/// [`frequency_encode`], without the position itself. `means` and `variances` are `[M, 3]`, scene
/// units and their square; the result is `[M, 6·L]`, differentiable in both. `window[l]` scales frequency `l`; a frequency
/// beyond its length has weight 1.
///
/// # Panics
/// If the shapes of means and variances differ.
pub fn integrated_encode(means: Tensor<2>, variances: Tensor<2>, frequencies: usize, window: &[f32]) -> Tensor<2> {
    assert_eq!(means.dims(), variances.dims(), "one variance per axis of a mean");
    let window = weights(frequencies, window);
    if window.is_empty() {
        return Tensor::zeros([means.dims()[0], 0], &means.device());
    }
    encode(means, Some(variances), window)
}

fn encode(points: Tensor<2>, variances: Option<Tensor<2>>, window: Vec<f32>) -> Tensor<2> {
    dispatch! {
        &points.device();
        host => {
            let ([rows, dims], integrated) = (points.dims(), variances.is_some());
            let kernel = host::EncodingKernel { dims, window, integrated };
            let shape = [rows, kernel.width()];
            crate::host::apply(kernel, shape, std::iter::once(points).chain(variances).map(Tensor::into_dispatch))
        },
        cube if points.dims()[0] > 0 => {
            let kernel = gpu::GpuEncoding { window, integrated: variances.is_some() };
            crate::cube::apply(kernel, std::iter::once(points).chain(variances).map(Tensor::into_dispatch))
        },
        plain => plain(points, variances, &window),
    }
}

fn weights(frequencies: usize, window: &[f32]) -> Vec<f32> {
    (0..frequencies).map(|frequency| window.get(frequency).copied().unwrap_or(1.0)).collect()
}

/// Computes [`integrated_encode`] if there are variances, else [`frequency_encode`], by plain tensor operations on any backend,
/// with a weight for each frequency.
pub fn plain(points: Tensor<2>, variances: Option<Tensor<2>>, window: &[f32]) -> Tensor<2> {
    let dtype = working_dtype(&points.device());
    let (wide, variances) = (points.clone().cast(dtype), variances.map(|variances| variances.cast(dtype)));
    let waves = window.iter().enumerate().flat_map(|(frequency, weight)| {
        let phase = wide.clone() * 2f64.powi(frequency as i32);
        let fading = variances.clone().map(|variances| (variances * (-0.5 * 4f64.powi(frequency as i32))).exp());
        [phase.clone().sin(), phase.cos()].map(|wave| match &fading {
            Some(fading) => (wave * (fading.clone() * *weight)).cast(FloatDType::F32),
            None => (wave * *weight).cast(FloatDType::F32),
        })
    });
    let point = variances.is_none().then(|| points.clone());
    Tensor::cat(point.into_iter().chain(waves).collect(), 1)
}

/// Returns the width of [`frequency_encode`] of a `dims`-dimensional point.
pub const fn encoded_width(dims: usize, frequencies: usize) -> usize {
    dims * (1 + 2 * frequencies)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::traffic::upload_rows;

    #[test]
    fn no_frequencies_or_no_points_give_an_empty_encoding() {
        let rows = |rows: &[f32]| upload_rows(rows, 3, &Device::flex());
        assert_eq!(integrated_encode(rows(&[0.0; 3]), rows(&[0.0; 3]), 0, &[]).dims(), [1, 0]);
        assert_eq!(integrated_encode(rows(&[]), rows(&[]), 4, &[]).dims(), [0, 24]);
    }
}
