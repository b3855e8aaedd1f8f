use std::path::PathBuf;

use thiserror::Error;

use crate::error::MetricError;

/// Reason why folders cannot be compared, in one line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum FolderError {
    /// Unreadable folder or image.
    #[error("{}: {cause}", path.display())]
    Read {
        /// Folder or image.
        path: PathBuf,
        /// Fault, in one line.
        cause: String,
    },
    /// Folder without images.
    #[error("{}: no PNG or JPEG images in it", folder.display())]
    Empty {
        /// Folder without images.
        folder: PathBuf,
    },
    /// Two images of a folder with the same name but for the extension.
    #[error("{} and {} have the same name", first.display(), second.display())]
    Twice {
        /// First file.
        first: PathBuf,
        /// Second file.
        second: PathBuf,
    },
    /// Image without a counterpart.
    #[error("{} has no {what} in {}: expected an image called `{name}`", path.display(), folder.display())]
    NoPartner {
        /// Image without a counterpart.
        path: PathBuf,
        /// Missing part: `truth`, `render`, `mask`.
        what: &'static str,
        /// Folder that was searched.
        folder: PathBuf,
        /// Name without extension.
        name: String,
    },
    /// Pair that cannot be compared.
    #[error("{}: {error}", path.display())]
    Pair {
        /// Render or mask.
        path: PathBuf,
        /// Reason.
        error: MetricError,
    },
}
