use std::{io, path::PathBuf};

use thiserror::Error;

/// Error of reading or writing a report or a record, in one line that names the file.
#[derive(Debug, Error)]
pub enum ReportError {
    /// Refusal by the file system.
    #[error("{}: cannot {action}: {reason}", path.display())]
    Io {
        /// Attempted action, as a verb: `read`, `write`, `list`, `create`.
        action: &'static str,
        /// File or folder.
        path: PathBuf,
        /// Reason given.
        reason: io::Error,
    },
    /// File that is not JSON, or not a list of records.
    #[error("{}: not a list of records: {reason}", path.display())]
    Syntax {
        /// File.
        path: PathBuf,
        /// Expected contents, and their place.
        reason: String,
    },
    /// Field of a record that is missing or holds something else.
    #[error("{}: record {index}: field `{field}`: {reason}", path.display())]
    Field {
        /// File.
        path: PathBuf,
        /// Position of the record in the file, from 0.
        index: usize,
        /// Name of the field.
        field: String,
        /// Expected value.
        reason: String,
    },
    /// Name of a record that cannot be a folder's name.
    #[error("{}: `{field}` is {value:?}: expected a name that can be a folder's: {reason}", path.display())]
    Name {
        /// Folder under which it would lie.
        path: PathBuf,
        /// `experiment`, `scene`, `variant` or `preset`.
        field: &'static str,
        /// Name.
        value: String,
        /// Reason why it cannot.
        reason: String,
    },
    /// File that other processes kept replacing.
    #[error("{}: other processes kept writing it; the record itself is saved, save any record again", path.display())]
    Contended {
        /// File.
        path: PathBuf,
    },
    /// Test view, or any, of which no run has an image.
    #[error("{}: no run has an image of {}", path.display(), view.map_or("any test view".to_owned(), |view| format!("test view {view}")))]
    NoPictures {
        /// Folder of the experiment.
        path: PathBuf,
        /// Id of the view; `None` for any.
        view: Option<usize>,
    },
    /// Chart that the drawing library refused.
    #[error("chart `{title}`: {reason}")]
    Chart {
        /// Title of the chart.
        title: String,
        /// Reason given.
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
