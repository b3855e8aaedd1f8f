//! The progress bar of a run.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::{Control, RunEvent};
use infonerf_train::{Event, Trainer};

use crate::interrupt;

/// Time between two updates of the bar.
const REFRESH: Duration = Duration::from_millis(100);

/// Shows the events of runs.
pub(crate) struct Progress {
    bar: ProgressBar,
    label: String,
    /// Fields that are trained at a time.
    beside: usize,
    shown: Option<Instant>,
}

impl Progress {
    /// A bar for runs called `label`.
    pub(crate) fn new(label: &str) -> anyhow::Result<Self> {
        let bar = ProgressBar::hidden();
        bar.set_style(ProgressStyle::with_template("{prefix} {wide_bar} {msg} {elapsed}")?);
        Ok(Self { bar, label: label.to_owned(), beside: 1, shown: None })
    }

    /// Shows `event`, and answers what the user wants.
    pub(crate) fn watch(&mut self, event: RunEvent<'_>) -> Control {
        match event {
            RunEvent::Loading => {}
            RunEvent::Started { fields, of } => {
                let which = match fields.len() {
                    _ if of == 1 => String::new(),
                    1 => format!(" field {} of {of}", fields.end),
                    _ => format!(" fields {} to {} of {of}", fields.start + 1, fields.end),
                };
                self.beside = fields.len();
                self.begin(format!("{}{which}", self.label), 1000);
            }
            RunEvent::Training { event, trainer } => self.training(event, trainer),
            RunEvent::Ended => self.bar.finish_and_clear(),
            RunEvent::Evaluating { view, views } => {
                if view == 0 {
                    self.begin(format!("{} test views", self.label), views as u64);
                }
                self.bar.set_position(view as u64 + 1);
                if view + 1 == views {
                    self.bar.finish_and_clear();
                }
            }
            RunEvent::Warning(warning) => self.bar.suspend(|| eprintln!("warning: {warning}")),
        }
        interrupt::control()
    }

    /// Does something that prints, with the bar out of the way.
    pub(crate) fn suspend<R>(&self, print: impl FnOnce() -> R) -> R {
        self.bar.suspend(print)
    }

    fn begin(&mut self, label: String, length: u64) {
        let style = self.bar.style();
        self.bar = ProgressBar::new(length).with_style(style);
        self.bar.set_prefix(label);
    }

    fn training(&mut self, event: &Event, trainer: &Trainer) {
        match event {
            Event::Step { step, seconds, loss, psnr, rays_per_second, .. } => {
                let now = Instant::now();
                if self.shown.is_none_or(|shown| now.duration_since(shown) > REFRESH) {
                    self.shown = Some(now);
                    let done = trainer.done();
                    let left = if done > 0.0 { self.beside as f64 * seconds * (1.0 - done) / done } else { f64::NAN };
                    self.bar.set_position((done * 1000.0) as u64);
                    self.bar.set_message(format!(
                        "step {step}  loss {loss:.4}  psnr {psnr:.1}  {:.0}k rays/s  {left:.0}s left",
                        rays_per_second / 1e3
                    ));
                }
            }
            Event::Plateau { step } => {
                self.bar.println(format!("step {step}: the training error has plateaued; the run ends here"));
            }
            Event::Collapse { step, restarted } => {
                let next = if *restarted { "starting over with other weights" } else { "giving up" };
                self.bar.println(format!("step {step}: the field went empty; {next}"));
            }
        }
    }
}
