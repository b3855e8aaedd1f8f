use std::fmt;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};
use infonerf_experiment::{Control, RunEvent};
use infonerf_train::{Event, Trainer};

use crate::interrupt;
use crate::print::{errln, outln};

/// Time between two updates of the bar.
const REFRESH: Duration = Duration::from_millis(100);

/// Returns a bar of `count` items called `label`, with the time left once it can be estimated.
pub(crate) fn counting_bar(label: &str, count: usize) -> ProgressBar {
    let bar = ProgressBar::new(count as u64).with_prefix(label.to_owned());
    let left = |state: &ProgressState, text: &mut dyn fmt::Write| {
        if state.pos() > 0 {
            // Errors of formatting the bar are ignored.
            let _ = write!(text, ", {:#} left", HumanDuration(state.eta()));
        }
    };
    if let Ok(style) = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} {elapsed}{left}") {
        bar.set_style(style.with_key("left", left));
    }
    bar
}

fn spinner(text: String) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(text);
    bar.enable_steady_tick(REFRESH);
    bar
}

/// Does `work` while a spinner beside `text` shows that it goes on.
pub(crate) fn with_spinner<T>(text: String, work: impl FnOnce() -> T) -> T {
    let bar = spinner(text);
    let result = work();
    bar.finish_and_clear();
    result
}

pub(crate) struct ProgressDisplay {
    bar: ProgressBar,
    label: String,
    /// Number of fields that are trained at a time.
    at_once: usize,
    shown: Option<Instant>,
}

impl ProgressDisplay {
    pub(crate) fn new(label: &str) -> Self {
        Self { bar: ProgressBar::hidden(), label: label.to_owned(), at_once: 1, shown: None }
    }

    /// Shows `event`, and returns the user's command: continue, save or stop.
    pub(crate) fn watch(&mut self, event: RunEvent<'_>) -> Control {
        self.show(event);
        interrupt::control()
    }

    pub(crate) fn show(&mut self, event: RunEvent<'_>) {
        match event {
            RunEvent::Loading => self.bar = spinner(format!("{}: reading the scene", self.label)),
            RunEvent::Started { fields, of } => {
                self.bar.finish_and_clear();
                let which = match fields.len() {
                    _ if of == 1 => String::new(),
                    1 => format!(" field {} of {of}", fields.end),
                    _ => format!(" fields {} to {} of {of}", fields.start + 1, fields.end),
                };
                self.at_once = fields.len();
                self.bar = ProgressBar::new(1000).with_prefix(format!("{}{which}", self.label));
                if let Ok(style) = ProgressStyle::with_template("{prefix} {bar:24} {wide_msg}") {
                    self.bar.set_style(style);
                }
            }
            RunEvent::Training { event, trainer } => self.training(event, trainer),
            RunEvent::Ended => self.bar.finish_and_clear(),
            RunEvent::Evaluating { view, views } => {
                if view == 0 {
                    self.bar = counting_bar(&format!("{} test views", self.label), views);
                }
                self.bar.set_position(view as u64);
                if view + 1 == views {
                    self.bar.finish_and_clear();
                }
            }
            RunEvent::Measuring => {}
            RunEvent::Warning(warning) => self.bar.suspend(|| errln!("warning: {warning}")),
            RunEvent::Note(note) => self.bar.suspend(|| outln!("{note}")),
        }
    }

    fn training(&mut self, event: &Event, trainer: &Trainer) {
        match event {
            Event::Step { step, seconds, loss, psnr, rays_per_second, .. } => {
                let now = Instant::now();
                if self.shown.is_none_or(|shown| now.duration_since(shown) > REFRESH) {
                    self.shown = Some(now);
                    let done = trainer.done();
                    let left = if done > 0.0 { self.at_once as f64 * seconds * (1.0 - done) / done } else { f64::NAN };
                    self.bar.set_position((done * 1000.0) as u64);
                    self.bar.set_message(format!(
                        "{left:.0} s left  training PSNR {psnr:.1}  step {step}  loss {loss:.4}  {:.0}k rays/s",
                        rays_per_second / 1e3
                    ));
                }
            }
            Event::Collapse { step, restarted } => {
                let next = if *restarted { "starting over with other weights" } else { "giving up" };
                self.bar.println(format!("step {step}: the field went empty; {next}"));
            }
        }
    }
}
