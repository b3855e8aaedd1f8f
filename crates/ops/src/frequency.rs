//! Positional encoding (NeRF, Eq. 4).

use burn::tensor::{FloatDType, Tensor};
use rayon::prelude::*;

use crate::composite::working_dtype;
use crate::dispatch::dispatch;

/// Encodes points with sines and cosines of doubling frequency.
///
/// γ(x) = (x, sin 2⁰x, cos 2⁰x, …, sin 2^(L−1)x, cos 2^(L−1)x), with `x` itself kept and no factor π, as the released
/// code has it: `[M, D]` → `[M, D·(1 + 2·L)]`, each frequency's sines before its cosines. `window[l]` scales frequency `l`
/// (FreeNeRF's annealing); a frequency beyond its length has weight 1. Differentiable in `points`:
/// `∂/∂x sin 2ˡx = 2ˡ cos 2ˡx`.
///
/// Finite for every finite point. On GPUs within 1e-6 where 2^(L−1)|x| < 10⁷, and without meaning far beyond that.
pub fn frequency_encode(points: Tensor<2>, frequencies: usize, window: &[f32]) -> Tensor<2> {
    let window = weights(frequencies, window);
    dispatch! {
        &points.device();
        host => {
            let dims = points.dims()[1];
            crate::kernel::apply(host::FrequencyKernel { dims, window }, points)
        },
        cube if points.dims()[0] > 0 => crate::cube::frequency(points, window),
        plain => plain(points, &window),
    }
}

/// The weight of each frequency.
pub(crate) fn weights(frequencies: usize, window: &[f32]) -> Vec<f32> {
    (0..frequencies).map(|frequency| window.get(frequency).copied().unwrap_or(1.0)).collect()
}

/// [`frequency_encode`] from plain tensor operations, on any backend, with a weight for each frequency.
pub fn plain(points: Tensor<2>, window: &[f32]) -> Tensor<2> {
    let wide = points.clone().cast(working_dtype(&points.device()));
    let waves = window.iter().enumerate().flat_map(|(frequency, weight)| {
        let phase = wide.clone() * 2f64.powi(frequency as i32);
        [phase.clone().sin(), phase.cos()].map(|wave| (wave * *weight).cast(FloatDType::F32))
    });
    Tensor::cat(std::iter::once(points.clone()).chain(waves).collect(), 1)
}

/// [`frequency_encode`] of rows on the host.
pub(crate) fn encode_rows(points: &[f32], dims: usize, window: &[f32]) -> Vec<f32> {
    let width = encoded_width(dims, window.len());
    let mut encoded = vec![0f32; points.len() / dims * width];
    encoded.par_chunks_mut(width * 256).zip(points.par_chunks(dims * 256)).for_each(|(out, x)| {
        for (out, x) in out.chunks_exact_mut(width).zip(x.chunks_exact(dims)) {
            encode(x, window, out);
        }
    });
    encoded
}

fn encode(x: &[f32], window: &[f32], out: &mut [f32]) {
    let dims = x.len();
    out[..dims].copy_from_slice(x);
    for (axis, &x) in x.iter().enumerate() {
        let blocks = out[dims..].chunks_exact_mut(2 * dims).zip(window);
        for ((block, weight), (sine, cosine)) in blocks.zip(sines_and_cosines(x)) {
            block[axis] = weight * sine;
            block[dims + axis] = weight * cosine;
        }
    }
}

/// (sin 2ˡx, cos 2ˡx) for l = 0, 1, …: by doubling the angle in `f64`, which loses one bit per frequency, so it starts anew every 16.
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

/// Σ 2ˡ(g_sin cos 2ˡx − g_cos sin 2ˡx) of one coordinate: the gradient that its sines and cosines hand on. `waves` and
/// `grad` begin at the coordinate's first sine; `step` further is its cosine, and another `step` the next sine.
pub(crate) fn wave_gradient(waves: &[f32], grad: &[f32], step: usize, frequencies: usize) -> f64 {
    let term = |frequency: usize| {
        let (sine, cosine) = (2 * step * frequency, (2 * frequency + 1) * step);
        let wide = |x: f32| f64::from(x);
        2f64.powi(frequency as i32) * (wide(grad[sine]) * wide(waves[cosine]) - wide(grad[cosine]) * wide(waves[sine]))
    };
    (0..frequencies).map(term).sum()
}

/// Width of the encoding of a `dims`-dimensional point.
pub const fn encoded_width(dims: usize, frequencies: usize) -> usize {
    dims * (1 + 2 * frequencies)
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use super::{encode_rows, encoded_width, wave_gradient};
    use crate::kernel::{Kernel, Pass};

    #[derive(Debug)]
    pub(super) struct FrequencyKernel {
        pub(super) dims: usize,
        pub(super) window: Vec<f32>,
    }

    impl Kernel for FrequencyKernel {
        fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![inputs[0][0], encoded_width(self.dims, self.window.len())]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            encode_rows(inputs[0], self.dims, &self.window)
        }

        fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let (dims, frequencies) = (self.dims, self.window.len());
            let width = encoded_width(dims, frequencies);
            let mut dpoints = vec![0.0; pass.inputs[0].len()];
            let rows = pass.output.par_chunks(width).zip(pass.grad.par_chunks(width));
            dpoints.par_chunks_mut(dims).zip(rows).for_each(|(dpoint, (waves, grad))| {
                for (axis, dx) in dpoint.iter_mut().enumerate() {
                    let first = (dims + axis).min(width);
                    let slope = wave_gradient(&waves[first..], &grad[first..], dims, frequencies);
                    *dx = (f64::from(grad[axis]) + slope) as f32;
                }
            });
            vec![Some(dpoints)]
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::{from_host, to_host};

    fn encoded(x: &[f32], dims: usize, frequencies: usize, window: &[f32]) -> Vec<f32> {
        to_host(frequency_encode(from_host(x, dims, &Device::flex()), frequencies, window))
    }

    #[test]
    fn matches_the_formula() {
        const FREQUENCIES: usize = 20;
        let x = [0.3f32, -1.2, 2.5];
        let got = encoded(&x, 3, FREQUENCIES, &[]);
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
        let (full, half) = (encoded(&[0.7], 1, 3, &[]), encoded(&[0.7], 1, 3, &[1.0, 0.5, 0.0]));
        assert_eq!(full[..3], half[..3]);
        assert_eq!([full[3] * 0.5, full[4] * 0.5, 0.0, 0.0], half[3..7]);
    }
}
