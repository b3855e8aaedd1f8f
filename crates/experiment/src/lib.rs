//! Experiments: files that list variants to compare, runs from scene to record, ensembles, sweeps, and the paper's tables.
//!
//! ```text
//! experiment file ─► plan ─► sweep ─► execute: Session::run (scene ─► fields ─► pictures, metrics) ─► records ─► report
//! ```
//!
//! A [`Session`] takes a [`RunPlan`] from its scene to its record and reports [`RunEvent`]s. [`execute::execute`] does so for
//! all runs of an experiment or a [`sweep::Sweep`], in this process, in processes of this machine or as jobs of Slurm, and
//! writes tables and the report: the command line and a program of your own call the same functions.
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

mod described;
mod device;
pub mod execute;
mod export;
mod file;
mod identity;
mod plan;
mod pretrain;
mod published;
mod records;
pub mod reproduce;
mod run;
mod run_plan;
mod scenes;
pub mod sweep;
#[cfg(test)]
mod testing;

pub use described::{ConfigKey, Description, config_keys, config_origins, describe};
pub use device::{DeviceName, OpenDevice, networks, open};
pub use export::SplatFidelity;
pub use file::list;
pub use plan::{About, Experiment, Selection};
pub use pretrain::{Pretrained, pretrain};
pub use records::{read_records, save_record};
pub use run::{Control, Existing, Finished, RunEvent, Session, Trained, Watch, is_finished, picture_notes};
pub use run_plan::RunPlan;
pub use scenes::{check_name, parse_seeds};
