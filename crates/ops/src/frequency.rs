//! Positional encoding (NeRF, Eq. 4).

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

/// Encodes `dims`-dimensional points with sines and cosines of doubling frequency.
///
/// γ(x) = (x, sin 2⁰x, cos 2⁰x, …, sin 2^(L−1)x, cos 2^(L−1)x), with `x` itself kept and no factor π, as the released
/// code has it. `points` is `[M·dims]` row-major on the host; the result is `[M, dims·(1 + 2·L)]` on `device`.
/// `window[l]` scales octave `l` (FreeNeRF's annealing); an octave beyond its length has weight 1.
///
/// Finite for every finite `points`. Sample positions are no parameters, so no gradient flows through this function.
pub fn frequency_encode(points: &[f32], dims: usize, octaves: usize, window: &[f32], device: &Device) -> Tensor<2> {
    let width = dims * (1 + 2 * octaves);
    let rows = points.len() / dims;
    let mut encoded = vec![0f32; rows * width];
    encoded.par_chunks_mut(width * 256).zip(points.par_chunks(dims * 256)).for_each(|(out, x)| {
        for (out, x) in out.chunks_exact_mut(width).zip(x.chunks_exact(dims)) {
            encode(x, octaves, window, out);
        }
    });
    Tensor::from_data(TensorData::new(encoded, [rows, width]), device)
}

fn encode(x: &[f32], octaves: usize, window: &[f32], out: &mut [f32]) {
    let dims = x.len();
    out[..dims].copy_from_slice(x);
    let mut scale = 1.0;
    for (octave, block) in out[dims..].chunks_exact_mut(2 * dims).enumerate().take(octaves) {
        let weight = window.get(octave).copied().unwrap_or(1.0);
        let (sines, cosines) = block.split_at_mut(dims);
        for ((x, sine), cosine) in x.iter().zip(sines).zip(cosines) {
            let (s, c) = if weight == 0.0 { (0.0, 0.0) } else { sin_cos(*x, scale) };
            *sine = weight * s;
            *cosine = weight * c;
        }
        scale *= 2.0;
    }
}

/// sin and cos of x · `scale`, also where that is beyond `f32`.
pub(crate) fn sin_cos(x: f32, scale: f32) -> (f32, f32) {
    let phase = x * scale;
    if phase.is_finite() {
        return phase.sin_cos();
    }
    let (sine, cosine) = (f64::from(x) * f64::from(scale)).sin_cos();
    (sine as f32, cosine as f32)
}

/// Width of the encoding of a `dims`-dimensional point.
pub const fn encoded_width(dims: usize, octaves: usize) -> usize {
    dims * (1 + 2 * octaves)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_the_formula() {
        let x = [0.3f32, -1.2, 2.5];
        let got = crate::to_host(frequency_encode(&x, 3, 4, &[], &Device::flex()));
        assert_eq!(got.len(), encoded_width(3, 4));
        assert_eq!(&got[..3], &x);
        for octave in 0..4 {
            for (axis, x) in x.iter().enumerate() {
                let phase = f64::from(*x) * 2f64.powi(octave as i32);
                let base = 3 + octave * 6 + axis;
                approx::assert_abs_diff_eq!(f64::from(got[base]), phase.sin(), epsilon = 1e-6);
                approx::assert_abs_diff_eq!(f64::from(got[base + 3]), phase.cos(), epsilon = 1e-6);
            }
        }
    }

    #[test]
    fn a_window_scales_its_octave_only() {
        let x = [0.7f32];
        let full = crate::to_host(frequency_encode(&x, 1, 3, &[], &Device::flex()));
        let half = crate::to_host(frequency_encode(&x, 1, 3, &[1.0, 0.5, 0.0], &Device::flex()));
        assert_eq!(full[..3], half[..3]);
        assert_eq!([full[3] * 0.5, full[4] * 0.5, 0.0, 0.0], half[3..7]);
    }
}
