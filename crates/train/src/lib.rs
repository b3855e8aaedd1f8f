//! Training: configs, the loop, checkpoints, events and evaluation.
//!
//! ```text
//! Config + Scene ─► Trainer ─► Event … ─► Checkpoint ─► evaluate
//! ```

mod checkpoint;
mod collapse;
pub mod config;
mod device_pixels;
mod early_stopping;
mod ensemble;
mod error;
mod error_sampling;
mod evaluate;
mod event;
mod information;
mod memory;
mod model;
mod photographs;
mod pixels;
mod profile;
mod progress;
mod step_pixels;
mod step_renderer;
mod test_pose;
mod trainer;
mod training_images;
mod training_scene;
mod weight_averaging;

pub use checkpoint::Checkpoint;
pub use collapse::EmptySteps;
pub use config::{Config, Preset};
pub use early_stopping::EarlyStopping;
pub use ensemble::{Stepped, member_seed, step_side_by_side, without_collapsed};
pub use error::TrainError;
pub use evaluate::{Evaluated, Evaluation, TestView, evaluate_view};
pub use event::Event;
pub use information::{Information, InformationQuery, information};
pub use memory::{MemoryPlan, available_memory};
pub use pixels::Pixels;
pub use profile::{Phase, Profile};
pub use progress::Progress;
pub use step_pixels::StepPixels;
pub use test_pose::fitted_to;
pub use trainer::{Outcome, Trainer};
pub use training_images::SeenPixels;
