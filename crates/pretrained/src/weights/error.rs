use std::path::PathBuf;

use thiserror::Error;

use super::KNOWN_WEIGHTS;

/// Failure to find, import or fetch weights, in one line.
#[derive(Debug, Error)]
pub enum WeightsError {
    /// Unknown name of weights.
    #[error("no weights are called `{name}`; known: {}", KNOWN_WEIGHTS.iter().map(|weights| weights.name).collect::<Vec<_>>().join(", "))]
    Unknown {
        /// The requested name.
        name: String,
    },
    /// Unreadable, unwritable or unsuitable file.
    #[error("{}: {cause}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The fault, in one line.
        cause: String,
    },
    /// Network that cannot be read; the line names the file.
    #[error("{0}")]
    Network(String),
    /// No cache folder for this user.
    #[error("no folder to keep weights in: set INFONERF_WEIGHTS to one")]
    NoFolder,
    /// Full disk.
    #[error("no space left in {}", folder.display())]
    NoSpace {
        /// The folder.
        folder: PathBuf,
    },
    /// Failed download; the line names the address.
    #[error("{0}")]
    Download(String),
}

impl WeightsError {
    /// Wraps an error of reading or writing `path`.
    pub(super) fn io(path: impl Into<PathBuf>, error: &std::io::Error) -> Self {
        let path = path.into();
        if error.kind() == std::io::ErrorKind::StorageFull {
            return Self::NoSpace { folder: path.parent().map_or(path.clone(), PathBuf::from) };
        }
        Self::File { path, cause: error.to_string() }
    }
}
