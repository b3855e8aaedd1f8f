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
    /// The file is not JSON, or not a list of records.
    #[error("{}: not a list of records: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What was expected, and where.
        reason: String,
    },
    /// A record lacks a field, or holds something else in it.
    #[error("{}: record {index}: field `{field}`: {reason}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Position of the record in the file, from 0.
        index: usize,
        /// The field's name.
        field: String,
        /// What was expected.
        reason: String,
    },
    /// A name of a record cannot be a folder's name.
    #[error("{}: `{field}` is {value:?}: expected a name that can be a folder's: {reason}", path.display())]
    Name {
        /// The folder under which it would lie.
        path: PathBuf,
        /// `experiment`, `scene`, `variant` or `preset`.
        field: &'static str,
        /// The name.
        value: String,
        /// Why it cannot.
        reason: String,
    },
    /// Other processes replaced the file again and again.
    #[error("{}: other processes kept writing it; the record itself is saved, save any record again", path.display())]
    Contended {
        /// The file.
        path: PathBuf,
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
