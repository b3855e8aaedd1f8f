use std::{collections::BTreeMap, fs, path::Path};

use serde_json::Value;

use crate::ReportError;

/// Training step of a `metrics.jsonl`, `"event": "step"`; `None` for values that its line lacks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepEvent {
    /// Optimizer step.
    pub step: f64,
    /// Training time so far, in seconds.
    pub seconds: Option<f64>,
    /// Total loss.
    pub loss: Option<f64>,
    /// Value of each term of the objective, unweighted, by its name.
    pub losses: BTreeMap<String, f64>,
    /// PSNR of the training batch, in decibels.
    pub psnr: Option<f64>,
}

/// Evaluation on test views during training, `"event": "eval"`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EvaluationEvent {
    /// Optimizer step.
    pub step: f64,
    /// Training time so far, in seconds.
    pub seconds: Option<f64>,
    /// Test PSNR in decibels.
    pub psnr: Option<f64>,
    /// Test SSIM.
    pub ssim: Option<f64>,
}

/// Events of a run, from its `metrics.jsonl`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Events {
    /// Training steps, in the order of the file.
    pub steps: Vec<StepEvent>,
    /// Evaluations, in the order of the file.
    pub evaluations: Vec<EvaluationEvent>,
    /// Number of lines that are not JSON, of an unknown event, or without a finite `step`, as the last line of a run
    /// that was killed often is.
    pub skipped: usize,
}

impl Events {
    /// Reads a `metrics.jsonl`. Lines that cannot be used are counted in [`Events::skipped`].
    ///
    /// # Errors
    /// [`ReportError::Io`] when the file cannot be read.
    pub fn read(path: &Path) -> Result<Self, ReportError> {
        let bytes = fs::read(path).map_err(ReportError::io("read", path))?;
        Ok(Self::parse(&String::from_utf8_lossy(&bytes)))
    }

    /// Reads events from the text of a `metrics.jsonl`, as [`Events::read`] does from its file.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let mut events = Self::default();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            if events.push(line).is_none() {
                events.skipped += 1;
            }
        }
        events
    }

    fn push(&mut self, line: &str) -> Option<()> {
        let value: Value = serde_json::from_str(line).ok()?;
        let number = |key: &str| value.get(key).and_then(Value::as_f64).filter(|number| number.is_finite());
        let (step, seconds, psnr) = (number("step")?, number("seconds"), number("psnr"));
        match value.get("event")?.as_str()? {
            "step" => {
                let terms = value.get("losses").and_then(Value::as_object).into_iter().flatten();
                let finite = |(name, value): (&String, &Value)| {
                    value.as_f64().filter(|value| value.is_finite()).map(|value| (name.clone(), value))
                };
                let losses = terms.filter_map(finite).collect();
                self.steps.push(StepEvent { step, seconds, loss: number("loss"), losses, psnr });
            }
            "eval" => self.evaluations.push(EvaluationEvent { step, seconds, psnr, ssim: number("ssim") }),
            "collapse" | "plateau" => {}
            _ => return None,
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_lines_are_read_and_others_counted() {
        let text = r#"{"event":"step","step":120,"seconds":3.2,"loss":0.012,"losses":{"rgb":0.01,"kl":null},"rays_per_second":1e5}

{"event":"eval","step":1000,"psnr":18.2,"ssim":null}
{"event":"checkpoint","step":1000}
[1, 2]
{"event":"step","loss":0.1}
{"event":"step","st"#;
        let events = Events::parse(text);
        let losses = BTreeMap::from([("rgb".to_owned(), 0.01)]);
        assert_eq!(
            events.steps,
            [StepEvent { step: 120.0, seconds: Some(3.2), loss: Some(0.012), losses, psnr: None }]
        );
        assert_eq!(
            events.evaluations,
            [EvaluationEvent { step: 1000.0, psnr: Some(18.2), ..EvaluationEvent::default() }]
        );
        assert_eq!(events.skipped, 4);
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = Events::read(Path::new("nowhere/metrics.jsonl")).unwrap_err().to_string();
        assert!(error.starts_with("nowhere/metrics.jsonl: cannot read:"), "{error}");
    }
}
