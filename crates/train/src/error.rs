use std::path::Path;

use infonerf_schedule::Fault;
use thiserror::Error;

/// Error of a run; each message is one line.
#[derive(Debug, Error)]
pub enum TrainError {
    /// A value of the config is out of range, or contradicts another one.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// A config or a checkpoint cannot be read, or a file not be written: one line with the key or the file, and the cause.
    #[error("{0}")]
    Config(String),
    /// A loss is not finite. The last checkpoint was taken before it.
    #[error("step {step}: the {what} is {value}, not a finite number; the last checkpoint is kept")]
    NonFinite {
        /// Name of the value, such as ``loss `entropy` ``.
        what: String,
        /// The value.
        value: f32,
        /// The step.
        step: usize,
    },
    /// A metric could not be computed.
    #[error(transparent)]
    Metric(#[from] infonerf_metrics::MetricError),
}

impl TrainError {
    pub(crate) fn config(key: impl std::fmt::Display, cause: impl std::fmt::Display) -> Self {
        // Control characters, such as line breaks, are escaped, as a message is one line.
        let escaped = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
        Self::Config(format!("{key}: {cause}").chars().map(escaped).collect())
    }

    /// Returns a fault of a file.
    pub fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        Self::Config(format!("{}: {}", path.display(), cause.to_string().lines().next().unwrap_or_default()))
    }
}
