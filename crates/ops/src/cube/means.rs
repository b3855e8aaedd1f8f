//! Sums over all numbers of a tensor that make a loss: one launch each way.

use burn::cubecl::{self, prelude::*};
use burn::tensor;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, Pass, apply, arg, empty, empty_like};

/// Threads that share a sum: all numbers of a batch of rays are few.
const THREADS: usize = 256;

/// What is summed up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Summand {
    /// (a − b)².
    SquaredDifference,
    /// a where b is above a threshold.
    Above,
}

/// `scale` times the sum of what `a` and `b`, of the same shape, make up, `[1]`; differentiable in `a`.
pub(crate) fn sum<const D: usize>(
    [a, b]: [tensor::Tensor<D>; 2],
    summand: Summand,
    threshold: f32,
    scale: f32,
) -> tensor::Tensor<1> {
    apply(Sum { summand, threshold, scale }, (a, b.detach()))
}

#[derive(Debug)]
struct Sum {
    summand: Summand,
    threshold: f32,
    scale: f32,
}

impl CubeKernel for Sum {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let out = empty(&inputs[0], [1]);
        add_up::launch(
            &out.client,
            CubeCount::new_single(),
            CubeDim::new_1d(THREADS as u32),
            arg(&inputs[0]),
            arg(&inputs[1]),
            arg(&out),
            self.threshold,
            self.scale,
            self.summand,
            THREADS,
        );
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [a, b] = pass.inputs else { unreachable!("a sum is of two inputs") };
        let da = empty_like(a);
        launch!(slopes::launch, a.meta.num_elements(); a, b, pass.grad, &da; self.threshold, self.scale, self.summand);
        vec![Some(da), None]
    }
}

#[cube(launch)]
fn add_up(
    a: &Tensor<f32>,
    b: &Tensor<f32>,
    out: &mut Tensor<f32>,
    threshold: f32,
    scale: f32,
    #[comptime] summand: Summand,
    #[comptime] threads: usize,
) {
    let unit = UNIT_POS as usize;
    let mut sum = 0.0f32;
    let mut i = UNIT_POS as usize;
    while i < a.len() {
        if comptime!(summand == Summand::SquaredDifference) {
            let difference = a[i] - b[i];
            sum += difference * difference;
        } else if b[i] > threshold {
            sum += a[i];
        }
        i += CUBE_DIM as usize;
    }
    let mut sums = Shared::<[f32]>::new_slice(threads);
    sums[unit] = sum;
    let mut half = CUBE_DIM as usize / 2;
    while half > 0 {
        sync_cube();
        if unit < half {
            let other = sums[unit + half];
            sums[unit] += other;
        }
        half /= 2;
    }
    if unit == 0 {
        out[0] = scale * sums[0];
    }
}

#[cube(launch)]
fn slopes(
    a: &Tensor<f32>,
    b: &Tensor<f32>,
    grad: &Tensor<f32>,
    da: &mut Tensor<f32>,
    threshold: f32,
    scale: f32,
    #[comptime] summand: Summand,
) {
    if ABSOLUTE_POS >= da.len() {
        terminate!();
    }
    let mut slope = 0.0f32;
    if comptime!(summand == Summand::SquaredDifference) {
        slope = 2.0f32 * (a[ABSOLUTE_POS] - b[ABSOLUTE_POS]);
    } else if b[ABSOLUTE_POS] > threshold {
        slope = 1.0f32;
    }
    da[ABSOLUTE_POS] = grad[0] * scale * slope;
}
