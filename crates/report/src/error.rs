use std::fmt::Display;
use std::path::Path;

use thiserror::Error;

/// Error of reading or writing a report or a record, in one line that names the file or chart.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct ReportError(pub(crate) String);

impl ReportError {
    /// Attaches the attempted `action` and its `path` to an error of the file system.
    pub(crate) fn io<E: Display>(action: &str, path: &Path) -> impl FnOnce(E) -> Self {
        move |reason| Self(format!("{}: cannot {action}: {reason}", path.display()))
    }

    /// Attaches the title of a chart to the reason that the drawing library gives.
    pub(crate) fn chart<E: Display>(title: &str) -> impl FnOnce(E) -> Self {
        move |reason| Self(format!("chart `{title}`: {reason}"))
    }
}
