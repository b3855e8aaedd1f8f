//! Integrated positional encoding (mip-NeRF, Sec. 3.1).

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use crate::frequency::sines_and_cosines;

/// The mean of the positional encoding over axis-aligned Gaussians in space (mip-NeRF, Eq. 13–14).
///
/// γ(μ, σ²) = (…, sin(2ˡμ) exp(−½ 4ˡσ²), cos(2ˡμ) exp(−½ 4ˡσ²), …) for each frequency l and axis, since E[sin x] of
/// x ~ N(μ, σ²) is sin μ · exp(−σ²/2): what is finer than the Gaussian fades out. Columns are in the order of
/// [`frequency_encode`](crate::frequency_encode), without the position itself. `means` and `variances` are `[M, 3]`
/// row-major on the host, scene units and their square; the result is `[M, 6·L]` on `device`. `window[l]` scales frequency
/// `l`; a frequency beyond its length has weight 1.
///
/// Positions are no parameters, so no gradient flows through this function.
///
/// # Panics
/// If there are not as many variances as means.
pub fn integrated_encode(
    means: &[f32],
    variances: &[f32],
    frequencies: usize,
    window: &[f32],
    device: &Device,
) -> Tensor<2> {
    const CHUNK: usize = 256;
    assert_eq!(means.len(), variances.len(), "one variance an axis of a mean");
    #[cfg(feature = "cube")]
    if crate::cube::serves(device) && !means.is_empty() && frequencies > 0 {
        return crate::cube::integrated(means, variances, frequencies, window, device);
    }
    let (rows, width) = (means.len() / 3, integrated_width(frequencies));
    let mut encoded = vec![0f32; rows * width];
    // A chunk of no width is no chunk.
    encoded
        .par_chunks_mut(width.max(1) * CHUNK)
        .zip(means.par_chunks(3 * CHUNK).zip(variances.par_chunks(3 * CHUNK)))
        .for_each(|(out, (means, variances))| {
            let gaussians = means.chunks_exact(3).zip(variances.chunks_exact(3));
            for (out, (mean, variance)) in out.chunks_exact_mut(width.max(1)).zip(gaussians) {
                encode(mean, variance, window, out);
            }
        });
    Tensor::from_data(TensorData::new(encoded, [rows, width]), device)
}

fn encode(mean: &[f32], variance: &[f32], window: &[f32], out: &mut [f32]) {
    for (axis, (&mean, &variance)) in mean.iter().zip(variance).enumerate() {
        let mut fading = -0.5 * f64::from(variance);
        for (frequency, (block, (sine, cosine))) in out.chunks_exact_mut(6).zip(sines_and_cosines(mean)).enumerate() {
            let weight = window.get(frequency).copied().unwrap_or(1.0) * fading.exp() as f32;
            block[axis] = weight * sine;
            block[3 + axis] = weight * cosine;
            fading *= 4.0;
        }
    }
}

/// Width of the encoding.
pub const fn integrated_width(frequencies: usize) -> usize {
    6 * frequencies
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{reference, to_host};

    const MEAN: [f32; 3] = [0.3, -1.2, 2.5];

    #[test]
    fn matches_the_integral() {
        let variance = [1e-4f32, 0.01, 0.5];
        let got = to_host(integrated_encode(&MEAN, &variance, 6, &[], &Device::flex()));
        assert_eq!(got.len(), integrated_width(6));
        for frequency in 0..6 {
            for (axis, (mean, variance)) in MEAN.into_iter().zip(variance).enumerate() {
                let scale = 2f64.powi(frequency as i32);
                let (mean, deviation) = (f64::from(mean) * scale, f64::from(variance).sqrt() * scale);
                let expected = |f: fn(f64) -> f64| reference::gaussian_mean(mean, deviation, f);
                let base = frequency * 6 + axis;
                approx::assert_abs_diff_eq!(f64::from(got[base]), expected(f64::sin), epsilon = 2e-6);
                approx::assert_abs_diff_eq!(f64::from(got[base + 3]), expected(f64::cos), epsilon = 2e-6);
            }
        }
    }

    #[test]
    fn of_a_point_is_the_plain_encoding() {
        let device = Device::flex();
        let window = [1.0, 0.5, 0.0];
        let got = to_host(integrated_encode(&MEAN, &[0.0; 3], 4, &window, &device));
        let plain = to_host(crate::frequency_encode(&MEAN, 3, 4, &window, &device));
        assert_eq!(got, plain[3..]);
    }

    #[test]
    fn no_frequencies_and_no_points() {
        let device = Device::flex();
        assert_eq!(integrated_encode(&MEAN, &[0.0; 3], 0, &[], &device).dims(), [1, 0]);
        assert_eq!(integrated_encode(&[], &[], 4, &[], &device).dims(), [0, 24]);
    }
}
