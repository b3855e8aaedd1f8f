//! Host kernel of [`bilinear`](super::bilinear()).

use rayon::prelude::*;

use super::Taps;
use crate::host::{Kernel, Pass};

const CHUNK: usize = 256;

#[derive(Debug)]
pub(super) struct BilinearKernel {
    pub(super) taps: Taps,
    pub(super) rows: usize,
    pub(super) channels: usize,
}

/// Adds `weight · row` to `sum`.
fn add(sum: &mut [f32], row: &[f32], weight: f32) {
    for (sum, value) in sum.iter_mut().zip(row) {
        *sum += weight * value;
    }
}

impl BilinearKernel {
    /// Lists the (place, weight) pairs that read each row of the table, in the order of places: the transpose of the
    /// taps. With it each thread writes rows of its own, and the order of sums is fixed.
    fn readers(&self) -> (Vec<u32>, Vec<(u32, f32)>) {
        let mut ends = vec![0u32; self.rows + 1];
        for row in self.taps.0.iter().flat_map(|(rows, _)| rows) {
            ends[*row as usize + 1] += 1;
        }
        for row in 0..self.rows {
            ends[row + 1] += ends[row];
        }
        let mut next = ends.clone();
        let mut readers = vec![(0, 0.0); 4 * self.taps.0.len()];
        for (place, (rows, weights)) in self.taps.0.iter().enumerate() {
            for (row, weight) in rows.iter().zip(weights) {
                let slot = &mut next[*row as usize];
                readers[*slot as usize] = (place as u32, *weight);
                *slot += 1;
            }
        }
        (ends, readers)
    }
}

impl Kernel for BilinearKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let &[table] = inputs else { unreachable!("bilinear reading has one input") };
        let channels = self.channels;
        let mut out = vec![0.0; self.taps.0.len() * channels];
        let rows = out.par_chunks_exact_mut(channels).zip(self.taps.0.par_iter()).with_min_len(CHUNK);
        rows.for_each(|(out, (rows, weights))| {
            for (row, weight) in rows.iter().zip(weights) {
                let start = *row as usize * channels;
                add(out, &table[start..start + channels], *weight);
            }
        });
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        if !pass.wanted[0] {
            return vec![None];
        }
        let (channels, grad) = (self.channels, pass.grad);
        let (ends, readers) = self.readers();
        let mut table = vec![0.0; self.rows * channels];
        table.par_chunks_exact_mut(channels).enumerate().with_min_len(CHUNK).for_each(|(row, sum)| {
            for (place, weight) in &readers[ends[row] as usize..ends[row + 1] as usize] {
                let start = *place as usize * channels;
                add(sum, &grad[start..start + channels], *weight);
            }
        });
        vec![Some(table)]
    }
}
