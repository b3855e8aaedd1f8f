//! Training of fields to their end, with checkpoints and logs.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use infonerf_train::{Checkpoint, Event, MemberStep, Outcome, Trainer, step_side_by_side};

use super::log::Log;
use crate::run::{Control, RunEvent, Watch};

/// Loads the newest intact checkpoint of a folder, and calls `warn` for each that is not intact.
pub(crate) fn load_checkpoint(folder: &Path, mut warn: impl FnMut(String)) -> Result<Option<Checkpoint>> {
    let (checkpoint, refused) = Checkpoint::load(folder)?;
    refused.iter().for_each(|reason| warn(format!("{reason}: continuing from the checkpoint before it")));
    Ok(checkpoint)
}

pub(crate) struct Training {
    pub(crate) trainer: Trainer,
    folder: PathBuf,
    log: Log,
    /// Whether there is nothing more to do.
    pub(crate) is_over: bool,
    /// Number of steps and seconds of training in earlier processes.
    before: (usize, f64),
    /// Duration of this process's first step in seconds, which includes the matching of images for stereo.
    pub(crate) first_step_seconds: f64,
}

impl Training {
    /// Prepares to train `trainer` further, and opens the log in `folder`.
    pub(crate) fn new(trainer: Trainer, folder: PathBuf) -> Result<Self> {
        let log = Log::open(&folder, trainer.progress())?;
        let before = (trainer.progress().step, trainer.progress().seconds);
        Ok(Self { trainer, folder, log, is_over: false, before, first_step_seconds: 0.0 })
    }

    /// Saves a checkpoint of the field, and logs the events that making it reports.
    fn save(&mut self, watch: &mut Watch<'_>) -> Result<Control> {
        let mut events = Vec::new();
        let checkpoint = self.trainer.checkpoint(&mut |event| events.push(event));
        let control = self.report(&events, watch)?;
        self.log.flush()?;
        let saved = checkpoint.with_context(|| self.folder.display().to_string())?.save(&self.folder);
        saved.context("the checkpoint could not be saved, and an earlier one is kept")?;
        Ok(control)
    }

    /// Logs events and passes them to `watch`. Returns the max of its answers: to stop, to save or to continue.
    fn report(&mut self, events: &[Event], watch: &mut Watch<'_>) -> Result<Control> {
        let mut control = Control::Continue;
        for event in events {
            self.log.write(event)?;
            control = control.max(watch(RunEvent::Training { event, trainer: &self.trainer }));
        }
        Ok(control)
    }

    /// Logs a step and passes it to `watch`, whose answer is returned; ends or saves the field if that is due.
    fn follow(
        &mut self,
        (events, outcome): MemberStep,
        checkpoint_every: usize,
        watch: &mut Watch<'_>,
    ) -> Result<Control> {
        let control = self.report(&events, watch)?;
        if outcome.is_err() {
            self.log.flush()?;
        }
        let outcome = outcome.with_context(|| self.folder.display().to_string())?;
        let step = self.trainer.progress().step;
        if step == self.before.0 + 1 {
            self.first_step_seconds = self.trainer.progress().seconds - self.before.1;
        }
        let is_due = control == Control::Save || (checkpoint_every > 0 && step.is_multiple_of(checkpoint_every));
        self.is_over = outcome != Outcome::Running;
        Ok(if is_due || self.is_over { control.max(self.save(watch)?) } else { control })
    }
}

/// Trains `fields` side by side until the end, or until `watch` stops them or panics (such as on printing into a closed
/// pipe). Each field is saved in every case, except one that meets a value that is not finite: it keeps its last
/// checkpoint, and ends the training of all fields.
pub(crate) fn train(fields: &mut [Training], checkpoint_every: usize, watch: &mut Watch<'_>) -> Result<()> {
    let mut panic = None;
    let mut guarded = |event: RunEvent<'_>| {
        catch_unwind(AssertUnwindSafe(|| watch(event))).unwrap_or_else(|payload| {
            panic = Some(payload);
            Control::Stop
        })
    };
    let trained = train_watched(fields, checkpoint_every, &mut guarded);
    match panic {
        Some(payload) => resume_unwind(payload),
        None => trained,
    }
}

fn train_watched(fields: &mut [Training], checkpoint_every: usize, watch: &mut Watch<'_>) -> Result<()> {
    loop {
        let mut active: Vec<&mut Training> = fields.iter_mut().filter(|field| !field.is_over).collect();
        if active.is_empty() {
            return Ok(());
        }
        let mut trainers: Vec<&mut Trainer> = active.iter_mut().map(|field| &mut field.trainer).collect();
        let stepped = step_side_by_side(&mut trainers);
        let (mut stop, mut failed, mut sound) = (false, None, Vec::new());
        for (field, stepped) in active.into_iter().zip(stepped) {
            match field.follow(stepped, checkpoint_every, watch) {
                Ok(control) => {
                    stop |= control == Control::Stop;
                    sound.push(field);
                }
                Err(error) => failed = failed.or(Some(error)),
            }
        }
        if stop || failed.is_some() {
            for field in sound.into_iter().filter(|field| !field.is_over) {
                field.save(watch)?;
            }
            return failed.map_or(Ok(()), Err);
        }
    }
}
