//! Host kernel of [`plane_variation`](super::plane_variation).

use std::sync::Arc;

use rayon::prelude::*;

use super::{FactoredLayout, weight};
use crate::host::buffers::zeros;
use crate::host::simd::{self, Job};
use crate::host::{Kernel, Pass};

#[derive(Debug)]
pub(super) struct VariationKernel(pub(super) Arc<FactoredLayout>);

/// Computes Σ (a − b)² in 16 running sums, which fill a vector.
#[inline(always)]
fn squares(a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 16;
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += (a[lane] - b[lane]) * (a[lane] - b[lane]);
        }
    }
    let mut sum = 0.0;
    for (a, b) in a_rest.iter().zip(b_rest) {
        sum += f64::from((a - b) * (a - b));
    }
    for lane in sums {
        sum += f64::from(lane);
    }
    sum
}

/// Sum of squared differences of neighbouring texels in a plane whose rows have `width` elements, `step` per texel.
struct SquaredDifferences<'a> {
    plane: &'a [f32],
    width: usize,
    step: usize,
    sum: &'a mut f64,
}

impl Job for SquaredDifferences<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        // Row by row, so that each sum in `f32` is short.
        for row in self.plane.chunks_exact(self.width) {
            *self.sum += squares(&row[self.step..], &row[..self.width - self.step]);
        }
        for (above, row) in self.plane.chunks_exact(self.width).zip(self.plane[self.width..].chunks_exact(self.width)) {
            *self.sum += squares(row, above);
        }
    }
}

/// Gradient of [`SquaredDifferences`] times half of `factor`, added to `out`.
struct DifferenceGradient<'a> {
    plane: &'a [f32],
    width: usize,
    step: usize,
    factor: f32,
    out: &'a mut [f32],
}

/// Adds k (from − to) to `out`.
#[inline(always)]
fn add_difference(out: &mut [f32], k: f32, from: &[f32], to: &[f32]) {
    for ((out, a), b) in out.iter_mut().zip(from).zip(to) {
        *out += k * (a - b);
    }
}

impl Job for DifferenceGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { plane, width, step, factor, out } = self;
        for (y, out) in out.chunks_exact_mut(width).enumerate() {
            let row = &plane[y * width..(y + 1) * width];
            add_difference(&mut out[..width - step], factor, row, &row[step..]);
            add_difference(&mut out[step..], factor, &row[step..], row);
            if y > 0 {
                add_difference(out, factor, row, &plane[(y - 1) * width..y * width]);
            }
            if (y + 2) * width <= plane.len() {
                add_difference(out, factor, row, &plane[(y + 1) * width..(y + 2) * width]);
            }
        }
    }
}

impl Kernel for VariationKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let levels = &self.0.levels;
        let part = |index: usize| {
            let level = &levels[index / 3];
            let plane = &inputs[0][level.plane(index % 3)..][..level.plane_len()];
            let mut sum = 0.0;
            let width = level.line_len();
            simd::run(SquaredDifferences { plane, width, step: level.channels, sum: &mut sum });
            sum * f64::from(weight(level.resolution))
        };
        let parts: Vec<f64> = (0..3 * levels.len()).into_par_iter().map(part).collect();
        vec![parts.iter().sum::<f64>() as f32]
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let tables = pass.inputs[0];
        let mut gradient = zeros(tables.len());
        self.0.split_tables(&mut gradient).into_par_iter().enumerate().for_each(|(index, out)| {
            let (level, p) = (&self.0.levels[index / 6], index % 6);
            if p < 3 {
                let plane = &tables[level.plane(p)..][..level.plane_len()];
                let factor = 2.0 * weight(level.resolution) * pass.grad[0];
                let width = level.line_len();
                simd::run(DifferenceGradient { plane, width, step: level.channels, factor, out });
            }
        });
        vec![Some(gradient)]
    }
}
