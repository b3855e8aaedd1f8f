//! Pause and stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// What the page of a [`Server`](super::Server) asks of the training in the same process. Clones share their state.
#[derive(Clone, Debug, Default)]
pub struct TrainingControl(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    paused: AtomicBool,
    stopped: AtomicBool,
    ended: AtomicBool,
    /// When a page last asked for the state of training.
    asked: Mutex<Option<Instant>>,
}

/// A request of the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
    Pause,
    Resume,
    Stop,
}

impl TrainingControl {
    /// Whether training should wait.
    pub fn is_paused(&self) -> bool {
        self.0.paused.load(Ordering::Relaxed)
    }

    /// Whether training should save and end.
    pub fn is_stopped(&self) -> bool {
        self.0.stopped.load(Ordering::Relaxed)
    }

    /// Tells the page that training has ended, so that it no longer offers to pause or stop it.
    pub fn end(&self) {
        self.0.ended.store(true, Ordering::Relaxed);
    }

    /// Whether a page has been open within the last while.
    pub fn is_watched(&self, within: Duration) -> bool {
        let asked = *self.0.asked.lock().unwrap_or_else(PoisonError::into_inner);
        asked.is_some_and(|asked| asked.elapsed() <= within)
    }

    pub(super) fn apply(&self, command: Command) {
        match command {
            Command::Pause => self.0.paused.store(true, Ordering::Relaxed),
            Command::Resume => self.0.paused.store(false, Ordering::Relaxed),
            Command::Stop => self.0.stopped.store(true, Ordering::Relaxed),
        }
    }

    /// Where training stands, as a page asks for it; null once it has ended.
    pub(super) fn state(&self) -> Value {
        if self.0.ended.load(Ordering::Relaxed) {
            return Value::Null;
        }
        *self.0.asked.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        json!({ "paused": self.is_paused(), "stopped": self.is_stopped() })
    }
}
