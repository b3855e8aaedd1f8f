use std::path::PathBuf;

use thiserror::Error;

use super::KNOWN_WEIGHTS;

/// Why weights cannot be had, in one line.
#[derive(Debug, Error)]
pub enum WeightsError {
    /// No weights have that name.
    #[error("no weights are called `{name}`; known: {}", KNOWN_WEIGHTS.iter().map(|weights| weights.name).collect::<Vec<_>>().join(", "))]
    Unknown {
        /// The name that was asked for.
        name: String,
    },
    /// A file is not what it should be, or cannot be read or written.
    #[error("{}: {cause}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with it.
        cause: String,
    },
    /// A network could not be read; the line names the file.
    #[error("{0}")]
    Network(String),
    /// The system has no cache folder for this user.
    #[error("no folder to keep weights in: set INFONERF_WEIGHTS to one")]
    NoFolder,
    /// There is no room for the weights.
    #[error("no space left in {}", folder.display())]
    NoSpace {
        /// The folder.
        folder: PathBuf,
    },
    /// The server cannot be reached.
    #[error("no connection to {url}: {cause}; without a network, `infonerf weights import FILE` takes a copy")]
    Connection {
        /// The requested value.
        url: String,
        /// What the system says.
        cause: String,
    },
    /// The server does not give the file.
    #[error("{url}: the server answered with HTTP status {status}")]
    Status {
        /// The requested value.
        url: String,
        /// HTTP status.
        status: u16,
    },
    /// The server has another file there.
    #[error("{url}: the server offers {found} bytes, expected {expected}")]
    Length {
        /// The requested value.
        url: String,
        /// Bytes offered.
        found: u64,
        /// Bytes of the published file.
        expected: u64,
    },
    /// The file did not arrive in full.
    #[error("{url}: the connection ended after {done} of {total} bytes; what has arrived is kept; try again to resume")]
    Truncated {
        /// The requested value.
        url: String,
        /// Bytes that have arrived.
        done: u64,
        /// Bytes of the file.
        total: u64,
    },
    /// What arrived is something else.
    #[error("{url}: wrong checksum: SHA-256 is {found}, expected {expected}; nothing was kept")]
    Checksum {
        /// The requested value.
        url: String,
        /// SHA-256 of what arrived.
        found: String,
        /// SHA-256 of what was published.
        expected: String,
    },
}

impl WeightsError {
    /// A fault in reading or writing `path`.
    pub(super) fn io(path: impl Into<PathBuf>, error: &std::io::Error) -> Self {
        let path = path.into();
        if error.kind() == std::io::ErrorKind::StorageFull {
            return Self::NoSpace { folder: path.parent().map_or(path.clone(), PathBuf::from) };
        }
        Self::File { path, cause: error.to_string() }
    }
}
