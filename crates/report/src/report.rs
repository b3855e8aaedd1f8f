//! Reports of one experiment or several, as files.

use std::path::{Path, PathBuf};

use crate::{ReportError, ReportInput, contents::ReportContents, files::write_atomically, html, markdown};

/// Files of a report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportFiles {
    /// `report.html`, which needs no other file.
    pub html: PathBuf,
    /// `report.md`, which links the images of the runs and `plots/*.svg`.
    pub markdown: PathBuf,
    /// Images and events that were left out, with the reason, a line each; the report lists them as well.
    pub missing: Vec<String>,
}

/// Writes `report.html`, `report.md`, `figure.png` and `plots/*.svg` into `root`, the experiment's folder, below which
/// the runs lie.
///
/// Images and events that are missing or cannot be read are left out and named in the report.
///
/// # Errors
/// [`ReportError::Io`] if a file cannot be written, [`ReportError::Chart`].
pub fn write_report(input: &ReportInput, root: &Path) -> Result<ReportFiles, ReportError> {
    let contents = ReportContents::gather(input, root)?;
    contents.write_plots(root)?;
    write_pages(root, &html::page(&contents), &markdown::page(&contents), contents.missing)
}

/// Writes `report.html` and `report.md` of several experiments into `root`, below which each has a folder of its name
/// with its own report: the claims of all, then tables, charts and a test view of each experiment.
///
/// # Errors
/// As [`write_report`].
pub fn write_collection(
    title: &str,
    introduction: &str,
    experiments: &[ReportInput],
    root: &Path,
) -> Result<ReportFiles, ReportError> {
    let gathered = experiments.iter().map(|input| ReportContents::gather(input, &root.join(&input.experiment)));
    let chapters: Vec<ReportContents> = gathered.collect::<Result<_, _>>()?;
    let html = html::collection_page(title, introduction, &chapters);
    let markdown = markdown::collection_page(title, introduction, &chapters);
    write_pages(root, &html, &markdown, chapters.into_iter().flat_map(|chapter| chapter.missing).collect())
}

fn write_pages(root: &Path, html: &str, markdown: &str, missing: Vec<String>) -> Result<ReportFiles, ReportError> {
    let files = ReportFiles { html: root.join("report.html"), markdown: root.join("report.md"), missing };
    write_atomically(&files.markdown, markdown.as_bytes())?;
    write_atomically(&files.html, html.as_bytes())?;
    Ok(files)
}
