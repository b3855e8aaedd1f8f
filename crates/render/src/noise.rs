//! Counter-based random numbers, which depend on their purpose and not on the order or number of threads.

use infonerf_ops::random::{Stream, below, mix};

/// The purpose of a stream of random numbers. Each use in the workspace has its own variant, so that no two share numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum RandomStream {
    /// Initial weights of a restart after a collapse.
    Restart,
    /// Initial weights and random numbers of a further field of an ensemble.
    EnsembleMember,
    /// The scene of a pre-training step.
    TrainingScene,
    /// Rays of training images.
    SeenRays,
    /// Rays of an unseen pose.
    UnseenRays,
    /// Rotation of the cameras of neighbouring rays.
    Neighbours,
    /// A whole picture from an unseen pose.
    Picture,
    /// Points at which the occupancy grid is updated.
    Occupancy,
    /// Points at which the finer occupancy grid of pictures is evaluated.
    RefinedOccupancy,
    /// The images that a field sees.
    Sources,
    /// Test rays whose entropy and information gain are reported.
    InformationRays,
    /// Neighbours of the test rays of [`RandomStream::InformationRays`].
    InformationNeighbours,
    /// A camera's pose.
    Pose,
    /// Choice of a view.
    View,
    /// A pixel's column.
    Column,
    /// A pixel's row.
    Row,
    /// A number of items.
    Count,
    /// Distances of samples along rays. The number 18 is fixed, as the results of runs depend on it.
    Samples = 18,
    /// Samples of a fine pass.
    FineSamples,
    /// A background colour.
    Background,
    /// Random numbers of the field itself, such as those of a latent code.
    Latent,
}

/// A stream of reproducible random numbers: number `i` of item `n` is a pure function of (seed, step, streams, n, i).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    seed: u64,
}

impl Noise {
    /// Makes the stream of one purpose in one step of a run.
    pub fn new(seed: u64, step: u64, stream: RandomStream) -> Self {
        Self::numbered(seed, step, stream as u64)
    }

    fn numbered(seed: u64, step: u64, stream: u64) -> Self {
        Self { seed: mix(mix(mix(seed) ^ step) ^ stream) }
    }

    /// Returns an independent stream within this one.
    pub fn child(self, stream: RandomStream) -> Self {
        self.numbered_child(stream as u64)
    }

    fn numbered_child(self, stream: u64) -> Self {
        // Roots differ from children in their number of rounds.
        Self { seed: mix(mix(self.seed).rotate_left(32) ^ stream) }
    }

    /// Returns number `index` of `item`, uniform in [0, 1).
    pub fn uniform(self, item: usize, index: usize) -> f32 {
        self.stream(item).uniform(index)
    }

    /// Returns number `index` of `item`, uniform in 0..`count`.
    pub fn below(self, item: usize, index: usize, count: usize) -> usize {
        below(self.seed, item, index, count)
    }

    /// Returns the stream's own seed, for generators that need one.
    pub fn bits(self) -> u64 {
        self.seed
    }

    pub(crate) fn stream(self, item: usize) -> Stream {
        Stream { key: self.seed, item }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    /// All streams, their children and grandchildren differ, also between steps and seeds.
    #[test]
    fn streams_differ_by_purpose_step_and_seed() {
        const STREAMS: std::ops::RangeInclusive<u64> = 0..=RandomStream::Latent as u64;
        let mut seen = HashSet::new();
        for (seed, step) in [(0, 0), (0, 1), (1, 0)] {
            for root in STREAMS {
                let root = Noise::numbered(seed, step, root);
                assert!(seen.insert(root.bits()));
                for child in STREAMS {
                    let child = root.numbered_child(child);
                    assert!(seen.insert(child.bits()));
                    for grandchild in STREAMS {
                        assert!(seen.insert(child.numbered_child(grandchild).bits()));
                    }
                }
            }
        }
    }
}
