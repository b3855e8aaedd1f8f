use std::{io, path::PathBuf};

use thiserror::Error;

/// Why a report, or a record of a run, could not be read or written. Each message is one line that names the file.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The file system refused.
    #[error("{}: cannot {action}: {reason}", path.display())]
    Io {
        /// What was attempted, as a verb: `read`, `write`, `list`, `create`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The reason given.
        reason: io::Error,
    },
    /// No run has a picture of a test view, or of any.
    #[error("{}: no run has a picture of {}", path.display(), view.map_or("any test view".to_owned(), |view| format!("test view {view}")))]
    NoPictures {
        /// The experiment's folder.
        path: PathBuf,
        /// Id of the view.
        view: Option<usize>,
    },
    /// The drawing library refused a chart.
    #[error("chart `{title}`: {reason}")]
    Chart {
        /// Title of the chart.
        title: String,
        /// The reason given.
        reason: String,
    },
}

impl ReportError {
    /// Attaches the attempted `action` and its `path` to an error of the file system.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |reason| Self::Io { action, path, reason }
    }
}
