use std::time::{Duration, Instant};

/// A part of a training step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Asking the field where there is something.
    Occupancy,
    /// Choosing rays.
    Rays,
    /// Rendering rays of training images.
    Seen,
    /// Rendering rays of unseen poses.
    Unseen,
    /// Rendering neighbouring rays.
    Neighbours,
    /// Gradients.
    Backward,
    /// Adam.
    Optimiser,
}

impl Phase {
    /// All of them, in the order of a step.
    pub const ALL: [Self; 7] =
        [Self::Occupancy, Self::Rays, Self::Seen, Self::Unseen, Self::Neighbours, Self::Backward, Self::Optimiser];

    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Occupancy => "occupancy",
            Self::Rays => "rays",
            Self::Seen => "seen rays",
            Self::Unseen => "unseen rays",
            Self::Neighbours => "neighbours",
            Self::Backward => "backward",
            Self::Optimiser => "optimiser",
        }
    }
}

/// Wall clock spent in each phase.
#[derive(Clone, Debug, Default)]
pub struct Profile {
    spent: [Duration; Phase::ALL.len()],
}

impl Profile {
    /// Runs `work` and books its time under `phase`.
    pub(crate) fn time<T>(&mut self, phase: Phase, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.spent[phase as usize] += start.elapsed();
        result
    }

    /// Time booked under `phase`.
    pub fn spent(&self, phase: Phase) -> Duration {
        self.spent[phase as usize]
    }
}
