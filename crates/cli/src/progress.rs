//! The progress bar of a run, and its log.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_train::Event;

/// Shows and logs the events of one run.
pub(crate) struct Progress {
    bar: ProgressBar,
    log: BufWriter<File>,
    path: PathBuf,
    shown: Option<std::time::Instant>,
}

impl Progress {
    /// Logs to `metrics.jsonl` in `run`, going on after `step`; 0 starts a new log.
    pub(crate) fn new(run: &Path, label: &str, step: usize) -> Result<Self> {
        let path = run.join("metrics.jsonl");
        let kept = if step > 0 { events_until(&path, step) } else { String::new() };
        let open = || -> std::io::Result<_> {
            let mut file = OpenOptions::new().create(true).write(true).truncate(true).open(&path)?;
            file.write_all(kept.as_bytes())?;
            Ok(file)
        };
        let log = BufWriter::new(open().with_context(|| path.display().to_string())?);
        let bar = ProgressBar::new(1000);
        let style = ProgressStyle::with_template("{prefix} {wide_bar} {msg} {elapsed}")?;
        bar.set_style(style);
        bar.set_prefix(label.to_owned());
        Ok(Self { bar, log, path, shown: None })
    }

    /// Logs `event`, and shows it when `done` ∈ [0, 1] of the run is done.
    pub(crate) fn report(&mut self, event: &Event, done: f64) -> Result<()> {
        let path = self.path.display();
        serde_json::to_writer(&mut self.log, event).with_context(|| path.to_string())?;
        self.log.write_all(b"\n").with_context(|| path.to_string())?;
        match event {
            Event::Step { step, seconds, loss, psnr, rays_per_second, .. } => {
                let now = std::time::Instant::now();
                if self.shown.is_none_or(|shown| now.duration_since(shown).as_millis() > 100) {
                    self.shown = Some(now);
                    let left = if done > 0.0 { seconds * (1.0 - done) / done } else { f64::NAN };
                    self.bar.set_position((done * 1000.0) as u64);
                    self.bar.set_message(format!(
                        "step {step}  loss {loss:.4}  psnr {psnr:.1}  {:.0}k rays/s  {left:.0}s left",
                        rays_per_second / 1e3
                    ));
                }
            }
            Event::Converged { step } => {
                self.bar.println(format!("step {step}: the training error falls no more; the run ends here"));
            }
            Event::Collapse { step, restarted } => {
                let next = if *restarted { "starting over with other weights" } else { "giving up" };
                self.bar.println(format!("step {step}: the field went empty; {next}"));
            }
        }
        Ok(())
    }

    /// Writes out what is buffered.
    pub(crate) fn flush(&mut self) -> Result<()> {
        self.log.flush().with_context(|| self.path.display().to_string())
    }

    /// Takes the bar away.
    pub(crate) fn finish(mut self) -> Result<()> {
        self.bar.finish_and_clear();
        self.flush()
    }
}

/// The lines of a log up to `step`: what came after is about to happen again.
fn events_until(path: &Path, step: usize) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let lines = text.lines().take_while(|line| match serde_json::from_str(line) {
        Ok(Event::Step { step: at, .. }) => at <= step,
        Ok(Event::Collapse { .. } | Event::Converged { .. }) => true,
        Err(_) => false,
    });
    lines.flat_map(|line| [line, "\n"]).collect()
}
