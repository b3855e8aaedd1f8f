//! Encodings of positions.

mod kernels;

use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;

pub(super) use self::kernels::{Angle, wave};
use super::{CubeKernel, Pass, apply, empty, empty_like, numbers};
use crate::frequency::encoded_width;
use crate::integrated::integrated_width;

/// [`frequency_encode`](crate::frequency_encode).
pub(crate) fn frequency(points: Tensor<2>, window: Vec<f32>) -> Tensor<2> {
    apply(Frequency { window }, points)
}

/// [`integrated_encode`](crate::integrated_encode).
pub(crate) fn integrated(means: Tensor<2>, variances: Tensor<2>, window: Vec<f32>) -> Tensor<2> {
    apply(Integrated { window }, (means, variances))
}

/// Of points, with the weight of each frequency.
#[derive(Debug)]
struct Frequency {
    window: Vec<f32>,
}

impl CubeKernel for Frequency {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let points = &inputs[0];
        let [rows, dims] = points.meta.shape().dims();
        let out = empty(points, [rows, encoded_width(dims, self.window.len())]);
        let window = numbers(&self.window, points);
        launch!(kernels::frequency::launch, rows * dims; points, &window, &out; self.window.len());
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let dpoints = empty_like(&pass.inputs[0]);
        launch!(
            kernels::frequency_backward::launch, dpoints.meta.num_elements();
            pass.output, pass.grad, &dpoints;
            self.window.len()
        );
        vec![Some(dpoints)]
    }
}

/// Of means and variances, with the weight of each frequency.
#[derive(Debug)]
struct Integrated {
    window: Vec<f32>,
}

impl CubeKernel for Integrated {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [means, variances] = inputs else { unreachable!("an integrated encoding has two inputs") };
        let [rows, dims] = means.meta.shape().dims();
        let out = empty(means, [rows, integrated_width(self.window.len())]);
        let window = numbers(&self.window, means);
        launch!(kernels::integrated::launch, rows * dims; means, variances, &window, &out; self.window.len());
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [dmeans, dvariances] = [0, 1].map(|input| empty_like(&pass.inputs[input]));
        launch!(
            kernels::integrated_backward::launch, dmeans.meta.num_elements();
            pass.output, pass.grad, &dmeans, &dvariances;
            self.window.len()
        );
        vec![Some(dmeans), Some(dvariances)]
    }
}
