//! One run from start to record: load, train, evaluate, write pictures.

mod evaluate;
mod folder;
mod log;
mod memory;
mod pictures;
#[cfg(test)]
mod tests;
mod train;
mod trained;
mod volume;

use std::collections::BTreeSet;
use std::fs;

use anyhow::{Context, Result, bail};
use infonerf_report::{Record, read_records};
use infonerf_train::{Trainer, without_collapsed};
use toml::{Table, Value};

pub use evaluate::picture_notes;
pub use folder::is_finished;
pub(crate) use folder::{clear, lock};
pub(crate) use memory::PeakMemory;
pub use pictures::save_png;
pub(crate) use train::{Ended, Training, load_checkpoint, train};
pub use trained::{Trained, total_progress};
pub use volume::TrainedVolume;

use crate::{Existing, Identity, RunEvent, RunPlan, Session, Watch};

/// The result of a run.
pub enum Finished {
    /// It is done. The fields are those that pictures are made of.
    Record(Box<Record>, Vec<Trainer>),
    /// It was done already; its record.
    Kept(Box<Record>),
    /// It was stopped, by whoever watches it or at [`Session::until`], and can be resumed.
    Stopped,
}

impl Session {
    /// Trains and evaluates `plan`, and leaves its folder; the record is not added to the experiment's `results.json`.
    ///
    /// # Errors
    /// If the scene cannot be read, training meets a number that is not finite, a file cannot be written, another process is
    /// at work on the run, or it is there already and [`Existing`] refuses that.
    pub fn run(&self, plan: &RunPlan, watch: &mut Watch<'_>) -> Result<Finished> {
        let folder = self.run_folder(plan);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let (_lock, warning) = lock(&folder, "run")?;
        if let Some(warning) = warning {
            watch(RunEvent::Warning(warning));
        }
        self.refuse_finished(std::slice::from_ref(plan))?;
        let identity = Identity::of(plan, self.device.name.name())?;
        let resumes = self.can_resume(plan, &folder, &identity)?;
        let record = plan.record_path(&folder);
        if resumes && record.exists() {
            let record = read_records(&record)?.pop().with_context(|| format!("{}: no record", record.display()))?;
            return Ok(Finished::Kept(Box::new(record)));
        }
        let (members, beside) = (plan.members(), self.device.name.fields_side_by_side());
        let loaded = self.loaded(plan);
        plan.check_memory(beside, loaded.is_some())?;
        let memory = PeakMemory::start();
        watch(RunEvent::Loading);
        let scene = loaded.map_or_else(|| self.load(plan), Ok)?;
        for warning in &scene.warnings {
            watch(RunEvent::Warning(format!("{}: {warning}", plan.scene)));
        }
        // What an earlier run left stays until this one is known to be possible.
        let mut first_trainer = Some(plan.trainer(&scene, 0, None, &self.device.device)?);
        if !resumes {
            clear(&folder)?;
        }
        infonerf_report::write_atomically(&folder.join("config.toml"), plan.to_toml()?.as_bytes())?;
        identity.write(&folder)?;
        let mut trainers = Vec::new();
        let mut stopped = false;
        for first in (0..members).step_by(beside) {
            let fields = first..members.min(first + beside);
            let mut training: Vec<Training> = Vec::new();
            for member in fields.clone() {
                let folder = plan.member_folder(&folder, member);
                fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
                let other = trainers.first().or_else(|| training.first().map(Training::trainer));
                let mut trainer = match first_trainer.take() {
                    Some(trainer) => trainer,
                    None => plan.trainer(&scene, member, other, &self.device.device)?,
                };
                if let Some(checkpoint) = load_checkpoint(&folder, watch)? {
                    trainer.resume(&checkpoint)?;
                }
                if self.profiled {
                    trainer.synchronize_phases();
                }
                training.push(Training::new(trainer, folder)?);
            }
            watch(RunEvent::Started { fields, of: members });
            train(&mut training, plan.config.train.checkpoint_every, self.until, watch)?;
            watch(RunEvent::Ended);
            for field in training {
                let (trainer, ended) = field.into_parts();
                match ended {
                    Ended::Over => {}
                    // Every field gets as far.
                    Ended::Until => stopped = true,
                    Ended::Stopped => return Ok(Finished::Stopped),
                }
                trainers.push(trainer);
            }
        }
        if stopped {
            return Ok(Finished::Stopped);
        }
        let progress = total_progress(&trainers);
        let (trainers, collapsed) = without_collapsed(trainers);
        let evaluated = evaluate::evaluate(self, plan, &folder, &trainers, &progress, collapsed, watch)?;
        Ok(match evaluated {
            Some(record) => {
                let record = Record { peak_rss_bytes: memory.peak(), ..record };
                Finished::Record(Box::new(record), trainers)
            }
            None => Finished::Stopped,
        })
    }

    /// Whether the run in `folder` is resumed.
    fn can_resume(&self, plan: &RunPlan, folder: &std::path::Path, identity: &Identity) -> Result<bool> {
        let path = folder.join("config.toml");
        if !self.existing.resumes() || !path.exists() {
            return Ok(false);
        }
        let Some(then) = Identity::read(folder) else {
            return match self.existing {
                Existing::Resume => bail!(
                    "{}: --resume needs the run's identity.json, which is missing or of another version",
                    folder.display()
                ),
                _ => Ok(false),
            };
        };
        let changes = identity.changes(&then);
        if changes.is_empty() {
            return Ok(true);
        }
        if self.existing == Existing::ResumeUnchanged {
            return Ok(false);
        }
        let found = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let difference = match first_difference(&found.parse()?, &plan.to_toml()?.parse()?) {
            Some((key, then, now)) => format!(" ({}: {key} was {then} and is {now})", path.display()),
            None => String::new(),
        };
        bail!(
            "{}: --resume needs the run as it began, but {} changed{difference}",
            folder.display(),
            changes.join(" and ")
        )
    }
}

/// The first key at which two configs differ, and its value in each.
fn first_difference(then: &Table, now: &Table) -> Option<(String, String, String)> {
    let keys: BTreeSet<&String> = then.keys().chain(now.keys()).collect();
    keys.into_iter().find_map(|key| match (then.get(key), now.get(key)) {
        (Some(Value::Table(then)), Some(Value::Table(now))) => {
            let (rest, then, now) = first_difference(then, now)?;
            Some((format!("{key}.{rest}"), then, now))
        }
        (then, now) if then == now => None,
        (then, now) => {
            let shown = |value: Option<&Value>| value.map_or_else(|| "absent".to_owned(), Value::to_string);
            Some((key.clone(), shown(then), shown(now)))
        }
    })
}
