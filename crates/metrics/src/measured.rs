use std::fmt;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::error::MetricError;
use crate::metric::Metric;

/// Value of each metric by its key, in the order of [`crate::METRICS`]; `None` if it could not be computed.
pub type Values = IndexMap<String, Option<f64>>;

/// Metrics of a set of views.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Measured {
    /// Values of each view, in the order in which views were added; without metrics of sets.
    pub views: Vec<Values>,
    /// Values of the set: means over views, and metrics of sets.
    pub set: Values,
    /// Reasons why values of the set are missing, or are means over fewer views.
    pub notes: Vec<Note>,
}

/// Remark on metrics; displayed as `KEY, KEY: REASON`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Note {
    /// Keys of the metrics concerned.
    pub metrics: Vec<String>,
    /// Reason in one line.
    pub reason: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.metrics.join(", "), self.reason)
    }
}

impl Measured {
    /// Checks that each of the requested `metrics` has a value.
    ///
    /// # Errors
    /// A metric has no value; the message names the first one, with the reason.
    pub fn require(&self, metrics: &[&Metric]) -> Result<(), MetricError> {
        let missing = metrics.iter().find(|metric| self.set.get(metric.key()).copied().flatten().is_none());
        let Some(metric) = missing else { return Ok(()) };
        let note = self.notes.iter().find(|note| note.metrics.iter().any(|key| key == metric.key()));
        let reason = note.map_or("was not measured", |note| &note.reason);
        Err(MetricError::other(format!("{}: {reason}", metric.key())))
    }

    /// Removes values that JSON cannot hold, such as the infinite PSNR of identical images; notes name those of the set.
    #[must_use]
    pub fn representable(mut self) -> Self {
        for value in self.views.iter_mut().flat_map(IndexMap::values_mut) {
            *value = value.filter(|value| value.is_finite());
        }
        for (key, value) in &mut self.set {
            if let Some(value) = value.take_if(|value| !value.is_finite()) {
                let reason = format!("{value}, which JSON cannot hold");
                self.notes.push(Note { metrics: vec![key.clone()], reason });
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::select;

    fn measured(psnr: Option<f64>) -> Measured {
        let set = Values::from([("psnr".to_owned(), psnr), ("fid".to_owned(), None)]);
        let note = Note { metrics: vec!["fid".into(), "kid".into()], reason: "too few".into() };
        Measured { views: vec![Values::from([("psnr".to_owned(), psnr)])], set, notes: vec![note] }
    }

    #[test]
    fn required_metrics_must_have_a_value() {
        let measured = measured(Some(20.0));
        assert_eq!(measured.require(&select(["psnr"]).unwrap()), Ok(()));
        for (key, expected) in [("ssim", "ssim: was not measured"), ("fid", "fid: too few")] {
            let error = measured.require(&select(["psnr", key]).unwrap()).unwrap_err();
            assert_eq!(error.to_string(), expected);
        }
        assert_eq!(measured.notes[0].to_string(), "fid, kid: too few");
    }

    #[test]
    fn infinity_becomes_a_note() {
        let measured = measured(Some(f64::INFINITY)).representable();
        assert_eq!((measured.set["psnr"], measured.views[0]["psnr"]), (None, None));
        assert_eq!(measured.notes[1].to_string(), "psnr: inf, which JSON cannot hold");
        let json = serde_json::to_string(&measured).unwrap();
        assert_eq!(serde_json::from_str::<Measured>(&json).unwrap(), measured);
    }
}
