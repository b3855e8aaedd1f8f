//! Reports of one experiment or several from `templates/`, each a page with its style, charts and images inside.

use std::path::{Path, PathBuf};

use askama::Template;

use crate::colormap::to_bytes;
use crate::contents::ReportContents;
use crate::error::ReportError;
use crate::files::write_atomically;
use crate::input::ReportInput;
use crate::quantity::Quantity;
use crate::record::Record;
use crate::table::measured;

#[derive(Template)]
#[template(path = "report.html")]
struct ReportPage<'a> {
    title: String,
    contents: &'a ReportContents<'a>,
    /// Quantities that at least one run has.
    quantities: Vec<Quantity>,
}

#[derive(Template)]
#[template(path = "collection.html")]
struct CollectionPage<'a> {
    title: &'a str,
    introduction: &'a str,
    chapters: &'a [ReportContents<'a>],
}

/// Writes `report.html`, `figure.png` and `plots/*.svg` into `root`, the experiment's folder, below which the runs lie, and
/// returns the path of the page, which needs no other file. More than eight scenes or variants have no `figure.png`.
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

/// Writes the `report.html` of several experiments into `root`, and returns its path: the claims of all, then tables, charts
/// and a test view of each experiment. Each experiment has a folder of its name below `root`, with its own report.
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

pub(crate) fn rendered(page: &impl Template) -> String {
    page.render().expect("formatting into a string cannot fail")
}

/// Keeps the arrow of a column's heading on the same line as the word before.
fn heading(text: impl AsRef<str>) -> String {
    text.as_ref().replace(" ↑", "\u{a0}↑").replace(" ↓", "\u{a0}↓").replace(" → ", "\u{a0}→\u{a0}")
}

fn shown(quantity: &Quantity, record: &Record) -> String {
    quantity.value(record).map_or("–".to_owned(), |value| quantity.format(value))
}

/// Formats the PSNR of a run, such as `18.92 dB`; empty if it has none.
fn psnr(record: &Record) -> String {
    Quantity::PSNR.value(record).map_or(String::new(), |psnr| format!("{} dB", Quantity::PSNR.format(psnr)))
}

/// Formats the run's means, such as `18.92 dB · SSIM 0.788 · seed 0`.
fn scores(record: &Record) -> String {
    let ssim = Quantity::SSIM.value(record).map(|ssim| format!("SSIM {}", Quantity::SSIM.format(ssim)));
    let parts = [psnr(record), ssim.unwrap_or_default(), format!("seed {}", record.seed)];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" · ")
}

/// Lists nine colours of a map for a gradient of CSS.
fn gradient(map: fn(f32) -> [f32; 3]) -> String {
    let stop = |i| {
        let [r, g, b] = to_bytes(map(i as f32 / 8.0));
        format!("rgb({r} {g} {b})")
    };
    (0..=8).map(stop).collect::<Vec<_>>().join(",")
}
