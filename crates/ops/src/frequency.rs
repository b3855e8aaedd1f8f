//! Positional encoding (NeRF, Eq. 4).

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

/// Encodes `dims`-dimensional points with sines and cosines of doubling frequency.
///
/// γ(x) = (x, sin 2⁰x, cos 2⁰x, …, sin 2^(L−1)x, cos 2^(L−1)x), with `x` itself kept and no factor π, as the released
/// code has it. `points` is `[M·dims]` row-major on the host; the result is `[M, dims·(1 + 2·L)]` on `device`.
/// `window[l]` scales frequency `l` (FreeNeRF's annealing); a frequency beyond its length has weight 1.
///
/// Finite for every finite `points`. Sample positions are no parameters, so no gradient flows through this function.
pub fn frequency_encode(points: &[f32], dims: usize, frequencies: usize, window: &[f32], device: &Device) -> Tensor<2> {
    #[cfg(feature = "cube")]
    if crate::cube::serves(device) && !points.is_empty() {
        return crate::cube::frequency(points, dims, frequencies, window, device);
    }
    let shape = [points.len() / dims, encoded_width(dims, frequencies)];
    Tensor::from_data(TensorData::new(encode_rows(points, dims, frequencies, window), shape), device)
}

/// [`frequency_encode`] on the host.
pub(crate) fn encode_rows(points: &[f32], dims: usize, frequencies: usize, window: &[f32]) -> Vec<f32> {
    let width = encoded_width(dims, frequencies);
    let mut encoded = vec![0f32; points.len() / dims * width];
    encoded.par_chunks_mut(width * 256).zip(points.par_chunks(dims * 256)).for_each(|(out, x)| {
        for (out, x) in out.chunks_exact_mut(width).zip(x.chunks_exact(dims)) {
            encode(x, frequencies, window, out);
        }
    });
    encoded
}

fn encode(x: &[f32], frequencies: usize, window: &[f32], out: &mut [f32]) {
    let dims = x.len();
    out[..dims].copy_from_slice(x);
    for (axis, &x) in x.iter().enumerate() {
        let blocks = out[dims..].chunks_exact_mut(2 * dims).take(frequencies);
        for (frequency, (block, (sine, cosine))) in blocks.zip(sines_and_cosines(x)).enumerate() {
            let weight = window.get(frequency).copied().unwrap_or(1.0);
            block[axis] = weight * sine;
            block[dims + axis] = weight * cosine;
        }
    }
}

/// (sin 2ˡx, cos 2ˡx) for l = 0, 1, …: by doubling the angle in `f64`, which loses one bit per frequency, so now and then anew.
pub(crate) fn sines_and_cosines(x: f32) -> impl Iterator<Item = (f32, f32)> {
    const ANEW: i32 = 16;
    let mut pair = (0f64, 1f64);
    (0..).map(move |frequency| {
        pair = match pair {
            _ if frequency % ANEW == 0 => (f64::from(x) * 2f64.powi(frequency)).sin_cos(),
            (sine, cosine) => (2.0 * sine * cosine, (cosine - sine) * (cosine + sine)),
        };
        (pair.0 as f32, pair.1 as f32)
    })
}

/// Width of the encoding of a `dims`-dimensional point.
pub const fn encoded_width(dims: usize, frequencies: usize) -> usize {
    dims * (1 + 2 * frequencies)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_the_formula() {
        const FREQUENCIES: usize = 20;
        let x = [0.3f32, -1.2, 2.5];
        let got = crate::to_host(frequency_encode(&x, 3, FREQUENCIES, &[], &Device::flex()));
        assert_eq!(got.len(), encoded_width(3, FREQUENCIES));
        assert_eq!(&got[..3], &x);
        for frequency in 0..FREQUENCIES {
            for (axis, x) in x.iter().enumerate() {
                let phase = f64::from(*x) * 2f64.powi(frequency as i32);
                let base = 3 + frequency * 6 + axis;
                approx::assert_abs_diff_eq!(f64::from(got[base]), phase.sin(), epsilon = 1e-7);
                approx::assert_abs_diff_eq!(f64::from(got[base + 3]), phase.cos(), epsilon = 1e-7);
            }
        }
    }

    #[test]
    fn a_window_scales_its_frequency_only() {
        let x = [0.7f32];
        let full = crate::to_host(frequency_encode(&x, 1, 3, &[], &Device::flex()));
        let half = crate::to_host(frequency_encode(&x, 1, 3, &[1.0, 0.5, 0.0], &Device::flex()));
        assert_eq!(full[..3], half[..3]);
        assert_eq!([full[3] * 0.5, full[4] * 0.5, 0.0, 0.0], half[3..7]);
    }
}
