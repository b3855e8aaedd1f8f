//! Rules by which samples are placed along rays, a file each. [`Placement`] lists them.

mod disparity;
mod interval;
mod left;
mod mid;

use std::fmt::Debug;

use burn::tensor::Tensor;
use infonerf_ops::sampling::{LastInterval, Streams, importance};
use serde::{Deserialize, Serialize};

/// A rule that places the samples of rays. Tensors are in no graph; `H` is the number of rays.
pub(crate) trait Rule: Debug + Sync {
    /// Returns the sorted coordinates of `count` samples of the first pass between the `ends`, near and far, `[H, 2]`:
    /// `[H, count]`, or one more of edges. Evenly spaced without `jitter`.
    fn first(&self, ends: Tensor<2>, count: usize, jitter: Option<&Streams>) -> Tensor<2>;

    /// Coordinates of the fine pass, drawn from the weights of samples at `t`, `[H, N]`, of optical depths `tau`, `[H N]`: by
    /// default merged with these.
    fn fine(&self, t: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        importance(t, tau, count, jitter)
    }

    /// Returns the coordinate of each sample that `t` places, and length of its interval, `[M]` each.
    fn intervals(&self, t: Tensor<2>, ends: Tensor<2>, last: LastInterval) -> [Tensor<1>; 2];

    /// Whether a sample stands for all of its interval, and has none in common with another pass.
    fn spans_intervals(&self) -> bool {
        false
    }

    /// Whether a single pass has steps of one length.
    fn marches(&self) -> bool {
        false
    }
}

/// Lists the rules: the name in configs (in lower case) and the rule.
macro_rules! placements {
    ($($(#[$doc:meta])* $name:ident => $rule:path,)*) => {
        /// Position of a sample within its interval.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "lowercase")]
        pub enum Placement {
            $($(#[$doc])* $name,)*
        }

        impl Placement {
            /// Every placement.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// Returns the rule that places samples so.
            pub(crate) fn rule(self) -> &'static dyn Rule {
                match self {
                    $(Self::$name => &$rule,)*
                }
            }
        }
    };
}

placements! {
    /// At the near end, as in NeRF: stratified distances, and interval i reaches from sample i to sample i + 1.
    Left => left::Left,
    /// In the middle. A single pass has steps of one length for all rays.
    Mid => mid::Mid,
    /// Over the whole interval (mip-NeRF): `samples + 1` edges bound `samples` intervals, and the fine pass has `fine_samples`
    /// intervals of its own, drawn from blurred weights and not merged with the coarse ones.
    Interval => interval::WholeInterval,
    /// At the near end, evenly spaced in disparity 1/t: dense near the camera (NeRF's `lindisp`).
    Disparity => disparity::Disparity,
}
