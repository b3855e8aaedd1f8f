/// Reason, in one line, why a field cannot be exported.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ExportError(pub(crate) String);
