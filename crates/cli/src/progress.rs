//! Progress bars.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::{Control, RunEvent};
use infonerf_train::{Event, Trainer};

use crate::interrupt;
use crate::print::errln;
use crate::terminal::columns_of_stderr;

/// Time between two updates of the bar.
const REFRESH: Duration = Duration::from_millis(100);

/// Columns of the shortest bar, with the spaces next to it.
const BAR: usize = 10;

/// Stages that are shorter than this are not reported.
const BRIEF: Duration = Duration::from_secs(2);

/// Returns a bar of `count` items called `label`, with the time left once it can be estimated.
pub(crate) fn counting_bar(label: &str, count: usize) -> ProgressBar {
    let bar = ProgressBar::new(count as u64).with_prefix(label.to_owned());
    if let Ok(style) = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} {elapsed}, {eta} left") {
        bar.set_style(style);
    }
    bar
}

/// Shows the events of a run.
pub(crate) struct ProgressDisplay {
    bar: ProgressBar,
    label: String,
    /// Fields that are trained at a time.
    at_once: usize,
    shown: Option<Instant>,
    /// When the stage at hand began, and how long reading and training took.
    stage: Instant,
    reading: Duration,
    training: Duration,
}

impl ProgressDisplay {
    /// Returns a bar for a run called `label`.
    pub(crate) fn new(label: &str) -> Self {
        let (stage, none) = (Instant::now(), Duration::ZERO);
        let (bar, label) = (ProgressBar::hidden(), label.to_owned());
        Self { bar, label, at_once: 1, shown: None, stage, reading: none, training: none }
    }

    /// Shows `event`, and returns the user's command: continue, save or stop.
    pub(crate) fn watch(&mut self, event: RunEvent<'_>) -> Control {
        self.show(event);
        interrupt::control()
    }

    /// Shows `event`.
    pub(crate) fn show(&mut self, event: RunEvent<'_>) {
        match event {
            RunEvent::Loading => {
                self.bar = ProgressBar::new_spinner().with_message(format!("{}: reading the scene", self.label));
                self.bar.enable_steady_tick(REFRESH);
            }
            RunEvent::Started { fields, of } => {
                self.bar.finish_and_clear();
                let reading = self.next_stage();
                self.reading += reading;
                let which = match fields.len() {
                    _ if of == 1 => String::new(),
                    1 => format!(" field {} of {of}", fields.end),
                    _ => format!(" fields {} to {} of {of}", fields.start + 1, fields.end),
                };
                self.at_once = fields.len();
                self.bar = ProgressBar::new(1000).with_prefix(format!("{}{which}", self.label));
                if let Ok(style) = ProgressStyle::with_template("{prefix} {wide_bar} {msg}") {
                    self.bar.set_style(style);
                }
            }
            RunEvent::Training { event, trainer } => self.training(event, trainer),
            RunEvent::Ended => {
                self.bar.finish_and_clear();
                let training = self.next_stage();
                self.training += training;
            }
            RunEvent::Evaluating { view, views } => {
                if view == 0 {
                    self.bar = counting_bar(&format!("{} test views", self.label), views);
                }
                self.bar.set_position(view as u64);
                if view + 1 == views {
                    self.bar.finish_and_clear();
                }
            }
            RunEvent::Warning(warning) => self.bar.suspend(|| errln!("warning: {warning}")),
        }
    }

    /// Returns how long the stages of the run took next to training, in brackets; empty if they were brief.
    pub(crate) fn stages(&self) -> String {
        let stages = [("reading the scene", self.reading), ("testing", self.stage.elapsed())];
        let long = stages.iter().filter(|(_, time)| *time >= BRIEF);
        let parts: Vec<String> = long.map(|(stage, time)| format!("{stage} {:.0} s", time.as_secs_f64())).collect();
        if parts.is_empty() { String::new() } else { format!(" (and {})", parts.join(", ")) }
    }

    fn next_stage(&mut self) -> Duration {
        let now = Instant::now();
        now.duration_since(std::mem::replace(&mut self.stage, now))
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
                    self.bar.set_message(fitting(
                        columns_of_stderr().saturating_sub(self.bar.prefix().chars().count() + BAR),
                        [
                            format!("{left:.0} s left"),
                            format!("training PSNR {psnr:.1}"),
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

/// Returns the first of `parts`, the most important first, that fit into `columns` with two spaces between them.
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
