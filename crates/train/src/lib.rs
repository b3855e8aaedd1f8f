//! Training: configs, schedules, the loop, checkpoints, events and evaluation.
//!
//! ```text
//! Config + Scene ─► Trainer ─► Event … ─► Checkpoint ─► evaluate
//! ```

mod average;
mod batch;
mod checkpoint;
pub mod config;
mod convergence;
mod error;
mod evaluate;
mod event;
mod explained;
mod members;
mod memory;
mod model;
mod photographs;
mod pretrain;
mod profile;
mod semantic;
mod trainer;

pub use checkpoint::{Checkpoint, Progress};
pub use config::{Config, Preset};
pub use error::TrainError;
pub use evaluate::{Evaluation, Information, InformationQuery, TestView, evaluate_view, information, show_nothing};
pub use event::Event;
pub use members::member_seed;
pub use memory::MemoryPlan;
pub use pretrain::Pretrainer;
pub use profile::{Phase, Profile};
pub use trainer::{Outcome, Trainer};
