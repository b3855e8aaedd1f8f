//! Integrated positional encoding (mip-NeRF, Sec. 3.1).

use burn::tensor::{FloatDType, Tensor};

use crate::composite::working_dtype;
use crate::dispatch::dispatch;
use crate::frequency::weights;

/// The mean of the positional encoding over axis-aligned Gaussians in space (mip-NeRF, Eq. 13–14).
///
/// γ(μ, σ²) = (…, sin(2ˡμ) exp(−½ 4ˡσ²), cos(2ˡμ) exp(−½ 4ˡσ²), …) for each frequency l and axis, since E[sin x] of
/// x ~ N(μ, σ²) is sin μ · exp(−σ²/2): detail finer than the Gaussian fades out. Columns are in the order of
/// [`frequency_encode`](crate::frequency_encode), without the position itself. `means` and `variances` are `[M, 3]`, scene
/// units and their square; the result is `[M, 6·L]`, differentiable in both. `window[l]` scales frequency `l`; a frequency
/// beyond its length has weight 1.
///
/// # Panics
/// If there are not as many variances as means.
pub fn integrated_encode(means: Tensor<2>, variances: Tensor<2>, frequencies: usize, window: &[f32]) -> Tensor<2> {
    assert_eq!(means.dims(), variances.dims(), "one variance per axis of a mean");
    let window = weights(frequencies, window);
    if window.is_empty() {
        return Tensor::zeros([means.dims()[0], 0], &means.device());
    }
    dispatch! {
        &means.device();
        host => crate::kernel::apply(host::IntegratedKernel { window }, (means, variances)),
        cube if means.dims()[0] > 0 => crate::cube::integrated(means, variances, window),
        plain => plain(means, variances, &window),
    }
}

/// [`integrated_encode`] from plain tensor operations, on any backend, with the weights of at least one frequency.
pub fn plain(means: Tensor<2>, variances: Tensor<2>, window: &[f32]) -> Tensor<2> {
    let [means, variances] = [means, variances].map(|input| input.clone().cast(working_dtype(&input.device())));
    let waves = window.iter().enumerate().flat_map(|(frequency, weight)| {
        let phase = means.clone() * 2f64.powi(frequency as i32);
        let fading = (variances.clone() * (-0.5 * 4f64.powi(frequency as i32))).exp() * *weight;
        [phase.clone().sin(), phase.cos()].map(|wave| (wave * fading.clone()).cast(FloatDType::F32))
    });
    Tensor::cat(waves.collect(), 1)
}

/// Width of the encoding.
pub const fn integrated_width(frequencies: usize) -> usize {
    6 * frequencies
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use super::integrated_width;
    use crate::frequency::{sines_and_cosines, wave_gradient};
    use crate::kernel::{Kernel, Pass};

    /// Rows that a task takes at a time.
    const CHUNK: usize = 256;

    #[derive(Debug)]
    pub(super) struct IntegratedKernel {
        pub(super) window: Vec<f32>,
    }

    impl IntegratedKernel {
        fn encode(&self, mean: &[f32], variance: &[f32], out: &mut [f32]) {
            for (axis, (&mean, &variance)) in mean.iter().zip(variance).enumerate() {
                let mut fading = -0.5 * f64::from(variance);
                let blocks = out.chunks_exact_mut(6).zip(&self.window);
                for ((block, weight), (sine, cosine)) in blocks.zip(sines_and_cosines(mean)) {
                    let weight = weight * fading.exp() as f32;
                    block[axis] = weight * sine;
                    block[3 + axis] = weight * cosine;
                    fading *= 4.0;
                }
            }
        }
    }

    impl Kernel for IntegratedKernel {
        fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![inputs[0][0], integrated_width(self.window.len())]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let &[means, variances] = inputs else { unreachable!("an integrated encoding has two inputs") };
            let width = integrated_width(self.window.len());
            let mut out = vec![0f32; means.len() / 3 * width];
            let gaussians = means.par_chunks(3 * CHUNK).zip(variances.par_chunks(3 * CHUNK));
            out.par_chunks_mut(width * CHUNK).zip(gaussians).for_each(|(out, (means, variances))| {
                let gaussians = means.chunks_exact(3).zip(variances.chunks_exact(3));
                for (out, (mean, variance)) in out.chunks_exact_mut(width).zip(gaussians) {
                    self.encode(mean, variance, out);
                }
            });
            out
        }

        fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let frequencies = self.window.len();
            let width = integrated_width(frequencies);
            let count = pass.inputs[0].len();
            let (mut dmeans, mut dvariances) = (vec![0.0; count], vec![0.0; count]);
            let rows = pass.output.par_chunks(width).zip(pass.grad.par_chunks(width));
            let gradients = dmeans.par_chunks_mut(3).zip(dvariances.par_chunks_mut(3));
            gradients.zip(rows).for_each(|((dmean, dvariance), (waves, grad))| {
                for axis in 0..3 {
                    dmean[axis] = wave_gradient(&waves[axis..], &grad[axis..], 3, frequencies) as f32;
                    let faded = |l: usize, at: usize| f64::from(grad[6 * l + at]) * f64::from(waves[6 * l + at]);
                    let term = |l: usize| -0.5 * 4f64.powi(l as i32) * (faded(l, axis) + faded(l, 3 + axis));
                    dvariance[axis] = (0..frequencies).map(term).sum::<f64>() as f32;
                }
            });
            vec![Some(dmeans), Some(dvariances)]
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::{frequency_encode, from_host, to_host};

    const MEAN: [f32; 3] = [0.3, -1.2, 2.5];

    fn encoded(means: &[f32], variances: &[f32], frequencies: usize, window: &[f32]) -> Tensor<2> {
        let [means, variances] = [means, variances].map(|rows| from_host(rows, 3, &Device::flex()));
        integrated_encode(means, variances, frequencies, window)
    }

    #[test]
    fn matches_the_integral() {
        let variance = [1e-4f32, 0.01, 0.5];
        let got = to_host(encoded(&MEAN, &variance, 6, &[]));
        assert_eq!(got.len(), integrated_width(6));
        for frequency in 0..6 {
            for (axis, (mean, variance)) in MEAN.into_iter().zip(variance).enumerate() {
                let scale = 2f64.powi(frequency as i32);
                let (mean, deviation) = (f64::from(mean) * scale, f64::from(variance).sqrt() * scale);
                let expected = |f: fn(f64) -> f64| infonerf_oracle::gaussian_mean(mean, deviation, f);
                let base = frequency * 6 + axis;
                approx::assert_abs_diff_eq!(f64::from(got[base]), expected(f64::sin), epsilon = 2e-6);
                approx::assert_abs_diff_eq!(f64::from(got[base + 3]), expected(f64::cos), epsilon = 2e-6);
            }
        }
    }

    #[test]
    fn of_a_point_is_the_plain_encoding() {
        let window = [1.0, 0.5, 0.0];
        let got = to_host(encoded(&MEAN, &[0.0; 3], 4, &window));
        let plain = to_host(frequency_encode(from_host(&MEAN, 3, &Device::flex()), 4, &window));
        assert_eq!(got, plain[3..]);
    }

    #[test]
    fn no_frequencies_and_no_points() {
        assert_eq!(encoded(&MEAN, &[0.0; 3], 0, &[]).dims(), [1, 0]);
        assert_eq!(encoded(&[], &[], 4, &[]).dims(), [0, 24]);
    }
}
