use burn::tensor::Tensor;
use infonerf_ops::sampling::{self, LastInterval, SampleRule, Streams};

use super::Rule;

/// [`Placement::Interval`](super::Placement::Interval).
#[derive(Debug)]
pub(super) struct WholeInterval;

impl Rule for WholeInterval {
    fn first(&self, ends: Tensor<2>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        let rays = ends.dims()[0];
        sampling::stratified(ends, [rays, count], SampleRule::Edges, jitter)
    }

    fn fine(&self, t: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        sampling::resample(t, tau, count, jitter)
    }

    fn intervals(&self, t: Tensor<2>, ends: Tensor<2>, last: LastInterval) -> [Tensor<1>; 2] {
        sampling::intervals(t, ends, SampleRule::Edges, last)
    }

    fn spans_intervals(&self) -> bool {
        true
    }
}
