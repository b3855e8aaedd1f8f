use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Error of loading a scene, selecting views from it, or writing it.
///
/// Every message is a single line with the place of the fault and what was expected there.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A required file or folder is missing.
    #[error("{}: not found; expected {expected}", .path.display())]
    NotFound {
        /// The missing file or folder.
        path: PathBuf,
        /// Description of the file or folder that is needed.
        expected: String,
    },
    /// The operating system refused to read or write.
    #[error("{}: {}", .path.display(), one_line(.reason))]
    Io {
        /// The file concerned.
        path: PathBuf,
        /// Reason that the system gives.
        reason: std::io::Error,
    },
    /// A file whose contents do not match its type: broken JSON, a truncated PNG, a malformed array.
    #[error("{}: expected {expected}: {reason}", .path.display())]
    Malformed {
        /// The file concerned.
        path: PathBuf,
        /// Description of a valid file.
        expected: String,
        /// The decoder's reason, with the position where it has one.
        reason: String,
    },
    /// A field of a file that is missing or has a value that cannot be used.
    #[error("{}: field `{field}`: expected {expected}, found {found}", .path.display())]
    Field {
        /// The file concerned.
        path: PathBuf,
        /// The path of the field within it, such as `frames[3].transform_matrix`.
        field: String,
        /// Description of a valid value.
        expected: String,
        /// Description of the value found.
        found: String,
    },
    /// A file or image larger than the limit for reading it.
    #[error("{}: {what} is {size}, more than the limit of {limit}", .path.display())]
    TooLarge {
        /// The file concerned.
        path: PathBuf,
        /// Name of the quantity that is too large.
        what: &'static str,
        /// Size of the file or image.
        size: u64,
        /// The largest size accepted.
        limit: u64,
    },
    /// A request (view selection, image size, background, …) that the scene cannot meet.
    #[error("request field `{field}`: expected {expected}, found {found}")]
    Request {
        /// The field of the request.
        field: &'static str,
        /// Description of a valid value.
        expected: String,
        /// Description of the value found.
        found: String,
    },
    /// A name that no built-in scene has.
    #[error("unknown procedural scene `{name}`; expected one of {known}")]
    UnknownScene {
        /// The name asked for.
        name: String,
        /// The known names, separated by commas.
        known: String,
    },
}

impl SceneError {
    /// Returns a [`SceneError::Io`].
    pub fn io(path: &Path, reason: std::io::Error) -> Self {
        Self::Io { path: path.into(), reason }
    }

    /// Returns a [`SceneError::Malformed`], with its reason in one line.
    pub fn malformed(path: &Path, expected: impl Into<String>, reason: impl Display) -> Self {
        Self::Malformed { path: path.into(), expected: expected.into(), reason: one_line(&reason) }
    }

    /// Returns a [`SceneError::Field`], with what was found in one line.
    pub fn field(path: &Path, field: impl Into<String>, expected: impl Into<String>, found: impl Display) -> Self {
        Self::Field { path: path.into(), field: field.into(), expected: expected.into(), found: one_line(&found) }
    }

    /// Returns a [`SceneError::Request`], with what was found in one line.
    pub fn request(field: &'static str, expected: impl Into<String>, found: impl Display) -> Self {
        Self::Request { field, expected: expected.into(), found: one_line(&found) }
    }
}

/// Returns the text of `value` with line breaks replaced and cut to a readable length.
fn one_line(value: &impl Display) -> String {
    const MAX_CHARACTERS: usize = 300;
    let mut line = value.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() > MAX_CHARACTERS {
        line = line.chars().take(MAX_CHARACTERS).collect::<String>() + "…";
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_and_bounded() {
        let reason = "first\nsecond\r\n".to_owned() + &"x".repeat(5000);
        let text = SceneError::malformed(Path::new("a.json"), "JSON", reason).to_string();
        assert!(!text.contains('\n') && text.chars().count() < 400, "{text}");
        assert!(text.starts_with("a.json: expected JSON: first second"));
    }
}
