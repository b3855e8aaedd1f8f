//! What a command prints on standard output: text, nothing, or events for other programs.

use std::time::{Duration, Instant};

use infonerf_experiment::RunEvent;
use infonerf_train::Event;
use serde_json::{Value, json};

use crate::print::outln;

/// Time between two steps that are told.
const REFRESH: Duration = Duration::from_secs(1);

/// How a command says what it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Output {
    /// For people: lines and progress bars.
    Text,
    /// Not at all.
    Quiet,
    /// One JSON object per line.
    Json,
}

impl Output {
    /// Prints a line for people.
    pub(crate) fn say(self, line: impl std::fmt::Display) {
        if self == Self::Text {
            outln!("{line}");
        }
    }

    /// Prints an event for programs.
    pub(crate) fn tell(self, event: &Value) {
        if self == Self::Json {
            outln!("{event}");
        }
    }
}

/// Tells the events of one run as JSON, steps once per second.
pub(crate) struct Told<'a> {
    label: &'a str,
    last: Option<Instant>,
}

impl<'a> Told<'a> {
    pub(crate) fn new(label: &'a str) -> Self {
        Self { label, last: None }
    }

    /// The event to print, if it is to be printed.
    pub(crate) fn event(&mut self, event: &RunEvent<'_>) -> Option<Value> {
        let run = self.label;
        Some(match event {
            RunEvent::Loading => json!({ "event": "loading", "run": run }),
            RunEvent::Started { fields, of } => {
                json!({ "event": "started", "run": run, "field": fields.start, "beside": fields.len(), "fields": of })
            }
            RunEvent::Training { event: Event::Step { step, seconds, loss, psnr, .. }, trainer } => {
                let now = Instant::now();
                if self.last.is_some_and(|last| now.duration_since(last) < REFRESH) {
                    return None;
                }
                self.last = Some(now);
                let done = trainer.done();
                json!({ "event": "step", "run": run, "step": step, "seconds": seconds, "done": done, "loss": loss, "psnr": psnr })
            }
            RunEvent::Training { event: Event::Plateau { step }, .. } => {
                json!({ "event": "plateau", "run": run, "step": step })
            }
            RunEvent::Training { event: Event::Collapse { step, restarted }, .. } => {
                json!({ "event": "collapse", "run": run, "step": step, "restarted": restarted })
            }
            RunEvent::Ended => json!({ "event": "trained", "run": run }),
            RunEvent::Evaluating { view, views } => {
                json!({ "event": "evaluating", "run": run, "view": view, "views": views })
            }
            RunEvent::Warning(warning) => json!({ "event": "warning", "run": run, "warning": warning }),
        })
    }
}
