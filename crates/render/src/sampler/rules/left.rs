use burn::tensor::Tensor;
use infonerf_ops::sampling::{self, LastInterval, SampleRule, Streams};

use super::Rule;

/// [`Placement::Left`](super::Placement::Left).
#[derive(Debug)]
pub(super) struct Left;

impl Rule for Left {
    fn first(&self, ends: Tensor<2>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        let rays = ends.dims()[0];
        sampling::stratified(ends, [rays, count], SampleRule::Left, jitter)
    }

    fn intervals(&self, t: Tensor<2>, ends: Tensor<2>, last: LastInterval) -> [Tensor<1>; 2] {
        sampling::intervals(t, ends, SampleRule::Left, last)
    }
}
