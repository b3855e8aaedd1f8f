//! Events of an experiment as JSON, one object per line, for other programs.

use std::time::{Duration, Instant};

use infonerf_experiment::RunEvent;
use infonerf_experiment::execute::{PlanEvent, RunEnd};
use infonerf_train::Event;
use serde_json::{Value, json};

/// Minimum time between two steps that are printed.
const REFRESH: Duration = Duration::from_secs(1);

/// Converter of events to JSON, with at most one step per second.
#[derive(Default)]
pub(crate) struct JsonEvents {
    last: Option<Instant>,
}

impl JsonEvents {
    pub(crate) fn event(&mut self, event: &PlanEvent<'_>) -> Option<Value> {
        match event {
            PlanEvent::Run(sweep, index, event) => self.run_event(&sweep.label(*index), event),
            PlanEvent::RunEnded(sweep, index, ended) => {
                let run = sweep.label(*index);
                self.last = None;
                Some(match ended {
                    RunEnd::Trained(record, _) | RunEnd::AlreadyDone(record) => {
                        json!({ "event": "record", "run": run, "record": record })
                    }
                    RunEnd::Stopped => json!({ "event": "stopped", "run": run }),
                    RunEnd::Failed(reason) => json!({ "event": "failed", "run": run, "reason": reason }),
                    RunEnd::Finished(_) => return None,
                })
            }
            PlanEvent::Started(..) | PlanEvent::Ended => None,
            PlanEvent::Written(_, outcome, _) => outcome
                .map(|outcome| json!({ "event": "finished", "report": outcome.report, "results": outcome.results })),
        }
    }

    fn run_event(&mut self, run: &str, event: &RunEvent<'_>) -> Option<Value> {
        Some(match event {
            RunEvent::Loading => json!({ "event": "loading", "run": run }),
            RunEvent::Started { fields, of } => {
                json!({ "event": "started", "run": run, "field": fields.start, "together": fields.len(), "fields": of })
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
            RunEvent::Training { event: Event::Collapse { step, restarted }, .. } => {
                json!({ "event": "collapse", "run": run, "step": step, "restarted": restarted })
            }
            RunEvent::Ended => json!({ "event": "trained", "run": run }),
            RunEvent::Evaluating { view, views } => {
                json!({ "event": "evaluating", "run": run, "view": view, "views": views })
            }
            RunEvent::Measuring => return None,
            RunEvent::Warning(warning) => json!({ "event": "warning", "run": run, "warning": warning }),
            RunEvent::Note(note) => json!({ "event": "note", "run": run, "note": note }),
        })
    }
}
