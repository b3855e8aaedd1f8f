use std::path::{Path, PathBuf};

use crate::{ReportError, ReportInput, contents::Contents, files::write_atomically, html, markdown};

/// Where a report was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportFiles {
    /// `report.html`, which needs no other file.
    pub html: PathBuf,
    /// `report.md`, which links the pictures of the runs and `plots/*.svg`.
    pub markdown: PathBuf,
    /// What was left out and why, one line each; the report lists it as well.
    pub missing: Vec<String>,
}

/// Writes `report.html`, `report.md` and `plots/*.svg` into `root`, the experiment's folder, below which the runs lie.
///
/// Pictures and events that are missing or cannot be read are left out and named in the report.
///
/// # Errors
/// [`ReportError::Io`] when a file cannot be written, [`ReportError::Chart`].
pub fn write_report(input: &ReportInput, root: &Path) -> Result<ReportFiles, ReportError> {
    let input = input.shown();
    let contents = Contents::gather(&input, root)?;
    contents.write_plots(root)?;
    let (html, markdown) = (root.join("report.html"), root.join("report.md"));
    write_atomically(&markdown, markdown::page(&contents).as_bytes())?;
    write_atomically(&html, html::page(&contents).as_bytes())?;
    Ok(ReportFiles { html, markdown, missing: contents.missing })
}
