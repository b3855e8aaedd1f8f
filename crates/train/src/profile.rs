use std::time::{Duration, Instant};

use burn::tensor::Device;

/// A part of a training step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Update of the occupancy grid.
    Occupancy,
    /// Drawing of pixels, and their rays.
    Rays,
    /// Rendering rays of training images.
    Seen,
    /// Rendering rays of unseen poses.
    Unseen,
    /// Rendering neighbouring rays.
    Neighbours,
    /// Backward pass.
    Backward,
    /// Adam's update of the parameters.
    Optimizer,
}

impl Phase {
    /// Every phase, in the order of a step, and its name in tables.
    pub const ALL: [(Self, &'static str); 7] = [
        (Self::Occupancy, "occupancy"),
        (Self::Rays, "rays"),
        (Self::Seen, "seen rays"),
        (Self::Unseen, "unseen rays"),
        (Self::Neighbours, "neighbours"),
        (Self::Backward, "backward"),
        (Self::Optimizer, "optimizer"),
    ];
}

/// Wall-clock time spent in each phase.
///
/// A GPU works asynchronously: unless it is waited for, its time is booked under the phase that first reads its results.
#[derive(Clone, Debug, Default)]
pub struct Profile {
    spent: [Duration; Phase::ALL.len()],
    /// Device that is waited for at the end of each phase.
    pub(crate) waits_for: Option<Device>,
}

impl Profile {
    pub(crate) fn time<T>(&mut self, phase: Phase, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.book(phase, start);
        result
    }

    /// Books the time since `start` under `phase`.
    pub(crate) fn book(&mut self, phase: Phase, start: Instant) {
        if let Some(device) = &self.waits_for {
            // Errors of the device are reported where its results are read.
            let _ = device.sync();
        }
        self.spent[phase as usize] += start.elapsed();
    }

    /// Returns the time booked under `phase`.
    pub fn spent(&self, phase: Phase) -> Duration {
        self.spent[phase as usize]
    }
}
