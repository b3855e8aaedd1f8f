//! Training of radiance fields: configs and presets, optimization, checkpoints, events, ensembles, evaluation on test views.
//!
//! ```text
//! Config + Scene ─► Trainer ─► Event … ─► Checkpoint ─► evaluate
//! ```

mod checkpoint;
pub mod config;
mod ensemble;
mod error;
mod evaluate;
mod event;
mod images;
mod information;
mod memory;
mod model;
mod pixels;
mod profile;
mod progress;
mod sources;
mod test_pose;
#[cfg(test)]
mod testing;
mod trainer;
mod training_scene;
mod weight_averaging;

pub use checkpoint::Checkpoint;
pub use config::{Config, Preset};
pub use ensemble::{MemberStep, member_seed, step_side_by_side, without_collapsed};
pub use error::TrainError;
pub use evaluate::{Evaluated, Evaluation, TestView, evaluate_view};
pub use event::Event;
pub use information::{Information, information};
pub use memory::{MemoryPlan, available_memory};
pub use model::weights;
pub use pixels::Pixels;
pub use profile::{Phase, Profile};
pub use progress::Progress;
pub use test_pose::fit_test_poses;
pub use trainer::{Outcome, StepBatch, Trainer};
