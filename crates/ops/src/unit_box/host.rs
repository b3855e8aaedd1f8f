//! Host kernel of [`unit_box`](super::unit_box).

use rayon::prelude::*;

use crate::kernel::{Kernel, Pass};

const CHUNK: usize = 3 << 12;

#[derive(Debug)]
pub(super) struct UnitBoxKernel {
    pub(super) low: [f32; 3],
    pub(super) scale: [f32; 3],
}

impl UnitBoxKernel {
    /// Computes `f(unclamped result, scale, index)` of each coordinate.
    fn each(&self, positions: &[f32], f: impl Fn(f32, f32, usize) -> f32 + Sync) -> Vec<f32> {
        let mut out = vec![0.0; positions.len()];
        let chunks = out.par_chunks_mut(CHUNK).zip(positions.par_chunks(CHUNK)).enumerate();
        chunks.for_each(|(chunk, (out, positions))| {
            for (row, (out, p)) in out.chunks_exact_mut(3).zip(positions.chunks_exact(3)).enumerate() {
                for axis in 0..3 {
                    let share = (p[axis] - self.low[axis]) * self.scale[axis];
                    out[axis] = f(share, self.scale[axis], chunk * CHUNK + 3 * row + axis);
                }
            }
        });
        out
    }
}

impl Kernel for UnitBoxKernel {
    fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
        self.each(inputs[0], |share, _, _| share.clamp(0.0, 1.0))
    }

    fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
        let inside = |share: f32| (0.0..=1.0).contains(&share);
        let gradient = |share, scale, index: usize| if inside(share) { scale * pass.grad[index] } else { 0.0 };
        vec![Some(self.each(pass.inputs[0], gradient))]
    }
}
