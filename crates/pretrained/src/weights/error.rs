use std::fmt::Display;
use std::io;
use std::path::Path;

use thiserror::Error;

/// Failure to find, import or fetch weights, in one line that names the file or address.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct WeightsError(pub(super) String);

impl WeightsError {
    pub(super) fn file(path: &Path, cause: impl Display) -> Self {
        Self(format!("{}: {cause}", path.display()))
    }

    pub(super) fn io(path: &Path, error: &io::Error) -> Self {
        if error.kind() == io::ErrorKind::StorageFull {
            return Self(format!("no space left in {}", path.parent().unwrap_or(path).display()));
        }
        Self::file(path, error)
    }
}
