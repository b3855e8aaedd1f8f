use std::path::PathBuf;

use thiserror::Error;

use crate::MetricError;

/// Why folders cannot be compared, in one line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum FolderError {
    /// A folder or picture cannot be read.
    #[error("{}: {cause}", path.display())]
    Read {
        /// The folder or picture.
        path: PathBuf,
        /// What is wrong with it.
        cause: String,
    },
    /// There are no pictures.
    #[error("{}: no PNG or JPEG pictures in it", folder.display())]
    Empty {
        /// The folder.
        folder: PathBuf,
    },
    /// Two pictures of a folder have the same name but for the extension.
    #[error("{} and {} have the same name", first.display(), second.display())]
    Twice {
        /// One of them.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// A picture has no counterpart.
    #[error("{} has no {what} in {}: expected a picture called `{name}`", path.display(), folder.display())]
    NoPartner {
        /// The picture.
        path: PathBuf,
        /// What is missing: `truth`, `render`, `mask`.
        what: &'static str,
        /// Where it was looked for.
        folder: PathBuf,
        /// Its name without extension.
        name: String,
    },
    /// A pair cannot be compared.
    #[error("{}: {error}", path.display())]
    Pair {
        /// The render or mask.
        path: PathBuf,
        /// What does not fit.
        error: MetricError,
    },
}
