//! Experiments: files that say what is compared, runs from scene to record, ensembles, sweeps, and the paper's tables
//! reproduced.
//!
//! ```text
//! experiment file ─► plan ─► Session::run: scene ─► fields ─► checkpoints ─► pictures, metrics ─► record ─► report
//! ```
//!
//! A [`Session`] does everything that a [`RunPlan`] says and reports [`RunEvent`]s; a command line, a benchmark, a sweep
//! and a program of your own call the same one.
//!
//! ```no_run
//! use infonerf_experiment::{Control, DeviceName, Existing, Experiment, Finished, Selection, Session, open};
//!
//! let selection = Selection { scenes: vec!["castle".into()], ..Selection::default() };
//! let experiment = Experiment::plan("synthetic-4view", &selection)?;
//! let session = Session::new(open(DeviceName::Auto)?, "runs", Existing::Continue);
//! for plan in &experiment.runs {
//!     if let Finished::Record(record, _) = session.run(plan, &mut |_| Control::Continue)? {
//!         println!("{}: {:?} dB", plan.label(), record.metrics["psnr"]);
//!     }
//! }
//! # Ok::<(), anyhow::Error>(())
//! ```

mod built_in;
mod device;
mod file;
mod identity;
pub mod launch;
mod plan;
mod plot;
mod pretrain;
mod published;
pub mod reproduce;
mod run;
mod run_plan;
mod scenes;
mod seeds;
mod session;
pub mod sweep;

pub use device::{DeviceName, OpenDevice, networks, open};
pub use file::list;
pub use identity::Identity;
pub use plan::{About, Experiment, Selection};
pub use pretrain::{Pretrained, pretrain};
pub use run::{Finished, Trained, TrainedVolume, is_finished, picture_notes, save_png, total_progress};
pub use run_plan::RunPlan;
pub use seeds::parse_seeds;
pub use session::{Control, Existing, RunEvent, Session, Watch};
