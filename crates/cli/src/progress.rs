//! The progress bar of a run.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::{Control, RunEvent};
use infonerf_train::{Event, Trainer};

use crate::interrupt;
use crate::print::errln;
use crate::terminal::columns_of_stderr;

/// Time between two updates of the bar.
const REFRESH: Duration = Duration::from_millis(100);

/// Columns of the shortest bar, with the spaces beside it.
const BAR: usize = 10;

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
        bar.set_style(ProgressStyle::with_template("{prefix} {wide_bar} {msg}")?);
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
            RunEvent::Warning(warning) => self.bar.suspend(|| errln!("warning: {warning}")),
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
                    self.bar.set_message(fitting(
                        columns_of_stderr().saturating_sub(self.bar.prefix().chars().count() + BAR),
                        [
                            format!("PSNR {psnr:.1}"),
                            format!("{left:.0} s left"),
                            format!("step {step}"),
                            format!("loss {loss:.4}"),
                            format!("{:.0}k rays/s", rays_per_second / 1e3),
                        ],
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

/// The first of `parts`, the most telling first, that fit into `columns` with two spaces between them.
fn fitting<const N: usize>(columns: usize, parts: [String; N]) -> String {
    let mut line = String::new();
    for part in parts {
        let longer = if line.is_empty() { part } else { format!("{line}  {part}") };
        if longer.chars().count() > columns {
            break;
        }
        line = longer;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_fits_the_terminal() {
        let line = |columns| fitting(columns, ["PSNR 20.1", "3 s left", "step 7"].map(str::to_owned));
        assert_eq!(line(80), "PSNR 20.1  3 s left  step 7");
        assert_eq!((line(26), line(18)), ("PSNR 20.1  3 s left".to_owned(), "PSNR 20.1".to_owned()));
        assert_eq!(line(3), "");
    }
}
