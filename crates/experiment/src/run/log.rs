//! `metrics.jsonl`: the events of a field's training.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use infonerf_report::EVENTS_FILE;
use infonerf_train::{Event, Progress};

pub(super) struct Log {
    file: BufWriter<File>,
    path: PathBuf,
}

impl Log {
    /// Opens `metrics.jsonl` in `folder` to append events after `progress`, and removes later lines.
    pub(super) fn open(folder: &Path, progress: &Progress) -> Result<Self> {
        let path = folder.join(EVENTS_FILE);
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            read => read.with_context(|| path.display().to_string())?,
        };
        infonerf_report::write_atomically(&path, events_until(&text, progress).as_bytes())?;
        let file = OpenOptions::new().append(true).open(&path).with_context(|| path.display().to_string())?;
        Ok(Self { file: BufWriter::new(file), path })
    }

    pub(super) fn write(&mut self, event: &Event) -> Result<()> {
        let line = serde_json::to_string(event)? + "\n";
        self.file.write_all(line.as_bytes()).with_context(|| self.path.display().to_string())
    }

    pub(super) fn flush(&mut self) -> Result<()> {
        self.file.flush().with_context(|| self.path.display().to_string())
    }
}

/// Returns the lines of a log up to `progress`, which counts restarts as well. Later steps are about to be taken again.
fn events_until(text: &str, progress: &Progress) -> String {
    let mut restarts = 0;
    let lines = text.lines().take_while(|line| {
        let step = match serde_json::from_str(line) {
            Ok(Event::Collapse { restarted: true, .. }) => {
                restarts += 1;
                0
            }
            Ok(Event::Step { step, .. } | Event::Collapse { step, .. }) => step,
            Err(_) => return false,
        };
        (restarts, step) <= (progress.restarts, progress.step)
    });
    lines.flat_map(|line| [line, "\n"]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a log of ten steps, a collapse at the tenth, and ten steps after the restart.
    fn log() -> String {
        let rest = r#""seconds":0.0,"loss":1.0,"losses":{},"psnr":1.0,"lr":1.0,"rays_per_second":1.0,"acc":0.0,"evaluated":1.0"#;
        let steps: String = (1..=10).map(|step| format!("{{\"event\":\"step\",\"step\":{step},{rest}}}\n")).collect();
        format!("{steps}{{\"event\":\"collapse\",\"step\":10,\"restarted\":true}}\n{steps}")
    }

    #[test]
    fn steps_that_happen_again_are_cut_off() {
        let text = log();
        // After a restart all lines before it stay. An incomplete line ends the log.
        for (restarts, step, cut, kept) in
            [(0, 0, 0, 0), (0, 4, 0, 4), (0, 10, 0, 10), (1, 0, 0, 11), (1, 4, 0, 15), (1, 10, 0, 21), (1, 10, 20, 20)]
        {
            let until = Progress { restarts, step, ..Progress::default() };
            let found = events_until(&text[..text.len() - cut], &until).lines().count();
            assert_eq!(found, kept, "{restarts} {step} {cut}");
        }
    }
}
