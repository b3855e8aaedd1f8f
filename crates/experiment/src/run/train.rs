//! Training of one field to its end, with checkpoints and a log.

use std::path::Path;

use anyhow::{Context, Result};
use infonerf_train::{Checkpoint, Event, Outcome, Trainer};

use super::log::Log;
use crate::{Control, RunEvent, Watch};

/// How training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// There is nothing more to do.
    Over(Outcome),
    /// It is as far as it was asked to go.
    Until,
    /// It was told to stop.
    Stopped,
}

/// The newest intact checkpoint of a folder, with a warning for each that is not intact.
pub(crate) fn load_checkpoint(folder: &Path, watch: &mut Watch<'_>) -> Result<Option<Checkpoint>> {
    let (checkpoint, refused) = Checkpoint::load(folder)?;
    for reason in refused {
        watch(RunEvent::Warning(format!("{reason}; going on from the checkpoint before it")));
    }
    Ok(checkpoint)
}

/// Trains until the end, the share `until` of the run, or until `watch` stops it, and saves in every case.
pub(crate) fn train(
    trainer: &mut Trainer,
    folder: &Path,
    checkpoint_every: usize,
    until: Option<f64>,
    watch: &mut Watch<'_>,
) -> Result<Ended> {
    let mut log = Log::open(folder, trainer.progress())?;
    let reached = |trainer: &Trainer| until.is_some_and(|share| trainer.done() >= share);
    if reached(trainer) && trainer.done() < 1.0 {
        return Ok(Ended::Until);
    }
    let ended = loop {
        let mut events: Vec<Event> = Vec::new();
        let outcome = trainer.step(&mut |event| events.push(event));
        let mut control = Control::Continue;
        for event in &events {
            log.write(event)?;
            control = control.max(watch(RunEvent::Training { event, trainer }));
        }
        match outcome {
            Ok(Outcome::Running) if control == Control::Stop => break Ended::Stopped,
            Ok(Outcome::Running) if reached(trainer) => break Ended::Until,
            Ok(Outcome::Running) => {
                let due = checkpoint_every > 0 && trainer.progress().step.is_multiple_of(checkpoint_every);
                if due || control == Control::Save {
                    log.flush()?;
                    trainer.checkpoint()?.save(folder)?;
                }
            }
            Ok(outcome) => break Ended::Over(outcome),
            Err(error) => {
                log.flush()?;
                return Err(error).with_context(|| folder.display().to_string());
            }
        }
    };
    log.flush()?;
    trainer.checkpoint()?.save(folder)?;
    Ok(ended)
}
