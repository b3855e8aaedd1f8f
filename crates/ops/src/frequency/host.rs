//! Host kernel of the encodings.

use rayon::prelude::*;

use crate::host::{Kernel, Pass};

const CHUNK: usize = 256;

/// Encoding of `[M, dims]` points, or of means and variances if `integrated`.
#[derive(Debug)]
pub(super) struct EncodingKernel {
    pub(super) dims: usize,
    pub(super) window: Vec<f32>,
    pub(super) integrated: bool,
}

impl EncodingKernel {
    /// Returns the column of the first sine, which follows the point unless the encoding is integrated.
    fn first_wave(&self) -> usize {
        if self.integrated { 0 } else { self.dims }
    }

    pub(super) fn width(&self) -> usize {
        self.first_wave() + 2 * self.dims * self.window.len()
    }

    fn encode(&self, point: &[f32], variance: Option<&[f32]>, out: &mut [f32]) {
        let dims = self.dims;
        let (copy, waves) = out.split_at_mut(self.first_wave());
        copy.copy_from_slice(&point[..copy.len()]);
        for (axis, &x) in point.iter().enumerate() {
            let mut exponent = variance.map(|variance| -0.5 * f64::from(variance[axis]));
            let blocks = waves.chunks_exact_mut(2 * dims).zip(&self.window);
            for ((block, &weight), (sine, cosine)) in blocks.zip(sines_and_cosines(x)) {
                let weight = weight * exponent.map_or(1.0, |exponent| exponent.exp() as f32);
                block[axis] = weight * sine;
                block[dims + axis] = weight * cosine;
                exponent = exponent.map(|exponent| 4.0 * exponent);
            }
        }
    }
}

/// Iterates over (sin 2ˡx, cos 2ˡx) for l = 0, 1, …, by doubling the angle in `f64`. As that loses one bit per frequency, every
/// 16th pair is computed anew.
fn sines_and_cosines(x: f32) -> impl Iterator<Item = (f32, f32)> {
    const PERIOD: i32 = 16;
    let mut pair = (0f64, 1f64);
    (0..).map(move |frequency| {
        pair = match pair {
            _ if frequency % PERIOD == 0 => (f64::from(x) * 2f64.powi(frequency)).sin_cos(),
            (sine, cosine) => (2.0 * sine * cosine, (cosine - sine) * (cosine + sine)),
        };
        (pair.0 as f32, pair.1 as f32)
    })
}

impl Kernel for EncodingKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let (points, variances) = (inputs[0], inputs.get(1));
        let (dims, width) = (self.dims, self.width());
        let mut out = vec![0f32; points.len() / dims * width];
        out.par_chunks_exact_mut(width).enumerate().with_min_len(CHUNK).for_each(|(row, out)| {
            let range = row * dims..(row + 1) * dims;
            self.encode(&points[range.clone()], variances.map(|variances| &variances[range]), out);
        });
        out
    }

    /// Computes Σ 2ˡ(g_sin cos 2ˡx − g_cos sin 2ˡx), the gradient with respect to x, and −½ Σ 4ˡ(g_sin sin 2ˡx + g_cos cos 2ˡx),
    /// the gradient with respect to σ².
    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let (dims, width, first) = (self.dims, self.width(), self.first_wave());
        let gradients = |coordinate: usize| {
            let (row, axis) = (coordinate / dims * width, coordinate % dims);
            let (mut dx, mut dvariance) = (0f64, 0f64);
            for l in 0..self.window.len() {
                let sine = row + first + 2 * dims * l + axis;
                let pair = |values: &[f32]| [sine, sine + dims].map(|at| f64::from(values[at]));
                let (out, grad) = (pair(pass.output), pair(pass.grad));
                dx += 2f64.powi(l as i32) * (grad[0] * out[1] - grad[1] * out[0]);
                dvariance -= 0.5 * 4f64.powi(l as i32) * (grad[0] * out[0] + grad[1] * out[1]);
            }
            let own = if self.integrated { 0.0 } else { f64::from(pass.grad[row + axis]) };
            ((own + dx) as f32, dvariance as f32)
        };
        let coordinates = (0..pass.inputs[0].len()).into_par_iter().with_min_len(CHUNK);
        let (dpoints, dvariances): (Vec<f32>, Vec<f32>) = coordinates.map(gradients).unzip();
        if self.integrated { vec![Some(dpoints), Some(dvariances)] } else { vec![Some(dpoints)] }
    }
}
