use burn::tensor::Tensor;
use infonerf_ops::sampling::{self, LastInterval, SampleRule, Streams};
use serde::{Deserialize, Serialize};

/// Position of a sample within its interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// At the near end, as in NeRF: stratified distances, and interval i reaches from sample i to sample i + 1.
    Left,
    /// In the middle. A single pass has steps of one length for all rays.
    Mid,
    /// Over the whole interval (mip-NeRF): `samples + 1` edges bound `samples` intervals, and the fine pass has `fine_samples`
    /// intervals of its own, drawn from blurred weights and not merged with the coarse ones.
    Interval,
}

/// `H` is the number of rays. No tensor is in an autodiff graph.
impl Placement {
    /// Every placement.
    pub const ALL: [Self; 3] = [Self::Left, Self::Mid, Self::Interval];

    fn rule(self) -> SampleRule {
        match self {
            Self::Left => SampleRule::Left,
            Self::Mid => SampleRule::Mid,
            Self::Interval => SampleRule::Edges,
        }
    }

    /// Returns the sorted coordinates of `count` samples of the first pass between the `ends`, near and far, `[H, 2]`:
    /// `[H, count]`, or `[H, count + 1]` of edges. Without `jitter` they are evenly spaced.
    pub(crate) fn first(self, ends: Tensor<2>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        let rays = ends.dims()[0];
        sampling::stratified(ends, [rays, count], self.rule(), jitter)
    }

    /// Draws the coordinates of the fine pass from the weights of samples at `t`, `[H, N]`, of optical depths `tau`, `[H N]`:
    /// merged with these unless they are edges.
    pub(crate) fn fine(self, t: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        match self {
            Self::Interval => sampling::resample(t, tau, count, jitter),
            Self::Left | Self::Mid => sampling::importance(t, tau, count, jitter),
        }
    }

    /// Returns the coordinate of each sample that `t` places, and the length of its interval, `[M]` each.
    pub(crate) fn intervals(self, t: Tensor<2>, ends: Tensor<2>, last: LastInterval) -> [Tensor<1>; 2] {
        sampling::intervals(t, ends, self.rule(), last)
    }

    /// Returns whether a sample represents its whole interval; the two passes then share no samples.
    pub(crate) fn spans_intervals(self) -> bool {
        self == Self::Interval
    }
}
