//! Host kernel of [`unit_box`](super::unit_box).

use rayon::prelude::*;

use super::share_of_box;
use crate::host::{Kernel, Pass};

const CHUNK: usize = 1 << 12;

#[derive(Debug)]
pub(super) struct UnitBoxKernel {
    pub(super) bounds: [[f32; 3]; 2],
}

impl Kernel for UnitBoxKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let positions = inputs[0].as_chunks::<3>().0.par_iter().with_min_len(CHUNK);
        positions.map(|&position| share_of_box(position, self.bounds)).collect::<Vec<_>>().into_flattened()
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let [low, high] = self.bounds;
        let shares = pass.output.as_chunks::<3>().0.par_iter().zip(pass.grad.as_chunks::<3>().0).with_min_len(CHUNK);
        let gradient = |(share, grad): (&[f32; 3], &[f32; 3])| {
            let inside = |axis: usize| share[axis] > 0.0 && share[axis] < 1.0;
            [0, 1, 2].map(|axis| if inside(axis) { grad[axis] / (high[axis] - low[axis]) } else { 0.0 })
        };
        vec![Some(shares.map(gradient).collect::<Vec<_>>().into_flattened())]
    }
}
