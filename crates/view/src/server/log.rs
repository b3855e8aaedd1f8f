//! Log of a run's training, read on as it grows.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use infonerf_report::{Events, StepEvent};

/// Number of bytes at the beginning of a log that distinguish it from the log of another training: its first step has its time.
const HEAD: u64 = 256;

/// Steps of one `metrics.jsonl`, up to the last line that was whole when it was read.
#[derive(Default)]
pub(super) struct Log {
    path: PathBuf,
    head: Vec<u8>,
    /// Number of bytes that were read.
    end: u64,
    events: Events,
}

impl Log {
    /// Returns the steps in the file at `path`; none if it cannot be read. Only what was added since the last call is read, unless
    /// that was about another file, or the training began anew.
    pub(super) fn steps(&mut self, path: &Path) -> &[StepEvent] {
        if self.path != path {
            *self = Self { path: path.to_owned(), ..Self::default() };
        }
        if self.read_on().is_err() {
            *self = Self::default();
        }
        &self.events.steps
    }

    fn read_on(&mut self) -> io::Result<()> {
        let mut file = File::open(&self.path)?;
        let mut head = Vec::new();
        file.by_ref().take(HEAD).read_to_end(&mut head)?;
        if file.metadata()?.len() < self.end || !head.starts_with(&self.head) {
            (self.end, self.events) = (0, Events::default());
        }
        self.head = head;
        file.seek(SeekFrom::Start(self.end))?;
        let mut added = Vec::new();
        file.read_to_end(&mut added)?;
        added.truncate(added.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1));
        self.end += added.len() as u64;
        self.events.append(&String::from_utf8_lossy(&added));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_are_added_are_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let line =
            |step: usize, seconds: f64| format!("{{\"event\":\"step\",\"step\":{step},\"seconds\":{seconds}}}\n");
        let [one, two, three] = [1, 2, 3].map(|step| line(step, 0.5));
        let mut log = Log::default();
        for (text, expected) in [
            (String::new(), 0),
            (one.clone(), 1),
            // The second line is being written.
            ([&*one, &two[..9]].concat(), 1),
            ([&*one, &two, &three].concat(), 3),
            // The training went on after its first step, and another one began.
            ([&*one, &two].concat(), 2),
            ([line(1, 0.75), line(2, 0.9), line(3, 1.0)].concat(), 3),
        ] {
            std::fs::write(&path, &text).unwrap();
            assert_eq!(log.steps(&path).len(), expected, "{text}");
            assert_eq!(log.events.skipped, 0, "{text}");
        }
        assert_eq!(log.steps(&path)[0].seconds, Some(0.75));
        // Lines that were read before are not read again.
        let long = |last: usize| (1..20).chain([last]).map(|step| line(step, 0.5)).collect::<String>();
        std::fs::write(&path, long(20)).unwrap();
        assert_eq!(log.steps(&path).len(), 20);
        std::fs::write(&path, long(99) + &line(21, 0.5)).unwrap();
        assert_eq!(log.steps(&path)[19..].iter().map(|step| step.step).collect::<Vec<_>>(), [20.0, 21.0]);
        assert!(log.steps(&folder.path().join("absent")).is_empty());
    }
}
