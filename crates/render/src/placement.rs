use infonerf_ops::sampling::SampleRule;
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

impl Placement {
    /// Every placement.
    pub const ALL: [Self; 3] = [Self::Left, Self::Mid, Self::Interval];

    pub(crate) fn rule(self) -> SampleRule {
        match self {
            Self::Left => SampleRule::Left,
            Self::Mid => SampleRule::Mid,
            Self::Interval => SampleRule::Edges,
        }
    }

    /// Returns whether a sample represents its whole interval; the two passes then share no samples.
    pub(crate) fn spans_intervals(self) -> bool {
        self == Self::Interval
    }
}
