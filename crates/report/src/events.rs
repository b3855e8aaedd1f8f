use std::{collections::BTreeMap, fs, path::Path};

use serde::{Deserialize, Deserializer};

use crate::error::ReportError;

/// Name of the file in the folder of a field's training that has an event per line.
pub const EVENTS_FILE: &str = "metrics.jsonl";

/// Training step of a `metrics.jsonl`, `"event": "step"`; `None` for values that its line lacks.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
pub struct StepEvent {
    /// Optimizer step.
    pub step: f64,
    /// Training time so far, in seconds.
    pub seconds: Option<f64>,
    /// Total loss.
    pub loss: Option<f64>,
    /// Value of each term of the objective, unweighted, by its name.
    #[serde(default, deserialize_with = "finite")]
    pub losses: BTreeMap<String, f64>,
    /// PSNR of the training batch, in decibels.
    pub psnr: Option<f64>,
}

/// Events of a run, from its `metrics.jsonl`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Events {
    /// Training steps, in the order of the file.
    pub steps: Vec<StepEvent>,
    /// Number of lines that are not JSON (such as the last one of a killed run), of an unknown event, or without a `step`.
    pub skipped: usize,
}

impl Events {
    /// Reads a `metrics.jsonl`. Lines that cannot be used are counted in [`Events::skipped`].
    pub fn read(path: &Path) -> Result<Self, ReportError> {
        let bytes = fs::read(path).map_err(ReportError::io("read", path))?;
        Ok(Self::parse(&String::from_utf8_lossy(&bytes)))
    }

    /// Reads events from the text of a `metrics.jsonl`, as [`Events::read`] does from its file.
    pub fn parse(text: &str) -> Self {
        let mut events = Self::default();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            match serde_json::from_str(line) {
                Ok(EventLine::Step(step)) => events.steps.push(step),
                Ok(EventLine::Collapse) => {}
                Err(_) => events.skipped += 1,
            }
        }
        events
    }
}

#[derive(Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
enum EventLine {
    Step(StepEvent),
    Collapse,
}

/// Reads the values that are numbers, and leaves out losses that were not finite, which are written as `null`.
fn finite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, f64>, D::Error> {
    let values: BTreeMap<String, Option<f64>> = Deserialize::deserialize(deserializer)?;
    Ok(values.into_iter().filter_map(|(name, value)| Some((name, value?))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_lines_are_read_and_others_counted() {
        let text = r#"{"event":"step","step":120,"seconds":3.2,"loss":0.012,"losses":{"rgb":0.01,"kl":null},"rays_per_second":1e5}

{"event":"collapse","step":1000,"restarted":true}
{"event":"checkpoint","step":1000}
[1, 2]
{"event":"step","loss":0.1}
{"event":"step","st"#;
        let events = Events::parse(text);
        let losses = BTreeMap::from([("rgb".to_owned(), 0.01)]);
        let step = StepEvent { step: 120.0, seconds: Some(3.2), loss: Some(0.012), losses, psnr: None };
        assert_eq!(events, Events { steps: vec![step], skipped: 4 });
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = Events::read(Path::new("nowhere/metrics.jsonl")).unwrap_err().to_string();
        assert!(error.starts_with("nowhere/metrics.jsonl: cannot read:"), "{error}");
    }
}
