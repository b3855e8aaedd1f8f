use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// Control of the training in the same process by the page of a [`Server`](super::Server). Clones share their state.
#[derive(Clone, Debug, Default)]
pub struct TrainingControl(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    paused: AtomicBool,
    stopped: AtomicBool,
    ended: AtomicBool,
    /// Time at which a page last requested the state of training.
    asked: Mutex<Option<Instant>>,
}

pub(super) const COMMANDS: [&str; 3] = ["/pause", "/resume", "/stop"];

impl TrainingControl {
    /// Returns whether training should wait.
    pub fn is_paused(&self) -> bool {
        self.0.paused.load(Ordering::Relaxed)
    }

    /// Returns whether training should save and end.
    pub fn is_stopped(&self) -> bool {
        self.0.stopped.load(Ordering::Relaxed)
    }

    /// Marks training as ended, so that the page no longer offers to pause or stop it.
    pub fn end(&self) {
        self.0.ended.store(true, Ordering::Relaxed);
    }

    /// Returns whether a page requested the state of training `within` this time before now.
    pub fn is_watched(&self, within: Duration) -> bool {
        let asked = *self.0.asked.lock().unwrap_or_else(PoisonError::into_inner);
        asked.is_some_and(|asked| asked.elapsed() <= within)
    }

    pub(super) fn apply(&self, command: &str) {
        if command == "/stop" {
            self.0.stopped.store(true, Ordering::Relaxed);
        } else {
            self.0.paused.store(command == "/pause", Ordering::Relaxed);
        }
    }

    /// Returns the state of training for a page that requests it; null once it has ended.
    pub(super) fn state(&self) -> Value {
        if self.0.ended.load(Ordering::Relaxed) {
            return Value::Null;
        }
        *self.0.asked.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        json!({ "paused": self.is_paused(), "stopped": self.is_stopped() })
    }
}
