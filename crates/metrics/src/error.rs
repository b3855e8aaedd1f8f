use std::fmt::Display;
use std::path::Path;

use thiserror::Error;

/// Reason why a metric has no value or images cannot be compared, in one line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum MetricError {
    /// No valid pixel to compare: the view has no values.
    #[error("no valid pixel to compare")]
    NothingValid,
    /// Any other reason.
    #[error("{0}")]
    Other(String),
}

impl MetricError {
    pub(crate) fn other(reason: impl Into<String>) -> Self {
        Self::Other(reason.into())
    }

    /// Returns the reason that `what` holds `found` values instead of `expected`.
    pub fn length(what: &str, found: usize, expected: usize) -> Self {
        Self::Other(format!("{what} holds {found} values, expected {expected}"))
    }

    /// Returns the reason that a value of `what` is NaN or infinite, at the pixel or value `index`.
    pub(crate) fn not_finite(what: &str, index: usize) -> Self {
        Self::Other(format!("{what} is not finite at index {index}"))
    }

    pub(crate) fn empty(what: &str) -> Self {
        Self::Other(format!("{what} is empty: a metric needs at least one value"))
    }

    pub(crate) fn file(path: &Path, cause: impl Display) -> Self {
        Self::Other(format!("{}: {cause}", path.display()))
    }
}
