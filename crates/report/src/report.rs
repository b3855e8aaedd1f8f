//! Reports of one experiment or several, as files.

use std::path::{Path, PathBuf};

use crate::contents::ReportContents;
use crate::error::ReportError;
use crate::files::write_atomically;
use crate::html::{CollectionPage, ReportPage, rendered};
use crate::input::ReportInput;
use crate::quantity::Quantity;
use crate::table::measured;

/// Writes `report.html`, `figure.png` and `plots/*.svg` into `root`, the experiment's folder, below which the runs lie, and
/// returns the path of the page, which needs no other file.
///
/// Images and events that are missing or cannot be read are left out and named in the report.
///
/// # Errors
/// If a file cannot be written, or a chart cannot be drawn.
pub fn write_report(input: &ReportInput, root: &Path) -> Result<PathBuf, ReportError> {
    let contents = ReportContents::gather(input, root)?;
    contents.write_plots(root)?;
    let html = root.join("report.html");
    let measured = |quantity: &Quantity| measured(&contents.records, *quantity);
    let quantities = Quantity::all().into_iter().filter(measured).collect();
    let page = ReportPage { title: input.heading(), contents: &contents, quantities };
    write_atomically(&html, rendered(&page).as_bytes())?;
    Ok(html)
}

/// Writes the `report.html` of several experiments into `root`, below which each has a folder of its name with its own
/// report: the claims of all, then tables, charts and a test view of each experiment. Returns its path.
///
/// # Errors
/// As [`write_report`].
pub fn write_collection(
    title: &str,
    introduction: &str,
    experiments: &[ReportInput],
    root: &Path,
) -> Result<PathBuf, ReportError> {
    let gathered = experiments.iter().map(|input| ReportContents::gather(input, &root.join(&input.experiment)));
    let chapters: Vec<ReportContents> = gathered.collect::<Result<_, _>>()?;
    let html = root.join("report.html");
    let page = CollectionPage { title, introduction, chapters: &chapters };
    write_atomically(&html, rendered(&page).as_bytes())?;
    Ok(html)
}
