//! `report.html`, the page of several experiments and `comparison.html` from `templates/`, each one file with its style,
//! charts and images inside.

use std::{fs, path::Path};

use askama::Template;
use base64::prelude::{BASE64_STANDARD, Engine};
use infonerf_metrics::Metric;

use crate::{
    colormap::to_bytes,
    comparison::{PictureComparison, cell},
    contents::ReportContents,
    error::ReportError,
    quantity::Quantity,
    record::Record,
    table::measured,
};

/// Maximum number of bytes of a comparison's images: browsers would take long to open more.
const MAX_BYTES: u64 = 96 << 20;

#[derive(Template)]
#[template(path = "report.html")]
struct ReportPage<'a> {
    title: String,
    contents: &'a ReportContents<'a>,
    /// Quantities that any run has.
    quantities: Vec<Quantity>,
}

#[derive(Template)]
#[template(path = "collection.html")]
struct CollectionPage<'a> {
    title: &'a str,
    introduction: &'a str,
    chapters: &'a [ReportContents<'a>],
}

#[derive(Template)]
#[template(path = "comparison.html")]
struct ComparisonPage<'a> {
    title: &'a str,
    protocol: String,
    comparison: &'a PictureComparison<'a>,
    metrics: &'a [&'a Metric],
    sliders: Vec<Slider<'a>>,
}

/// View with a slider between render and truth, which are URLs that hold the images.
struct Slider<'a> {
    name: &'a str,
    truth: String,
    render: String,
    scores: String,
}

fn rendered(page: &impl Template) -> String {
    page.render().expect("formatting into a string cannot fail")
}

pub(crate) fn report_page(contents: &ReportContents) -> String {
    let measured = |quantity: &Quantity| measured(&contents.records, *quantity);
    let quantities = Quantity::all().into_iter().filter(measured).collect();
    rendered(&ReportPage { title: contents.input.heading(), contents, quantities })
}

pub(crate) fn collection_page(title: &str, introduction: &str, chapters: &[ReportContents]) -> String {
    rendered(&CollectionPage { title, introduction, chapters })
}

/// Makes the page of other programs' renders, with as many views as browsers open quickly.
pub(crate) fn comparison_page(comparison: &PictureComparison) -> Result<String, ReportError> {
    let metrics = comparison.metrics();
    let size = |path: &Path| fs::metadata(path).map(|file| file.len()).map_err(ReportError::io("read", path));
    let (mut sliders, mut bytes) = (Vec::new(), 0);
    for (view, values) in comparison.compared.views.iter().zip(&comparison.compared.measured.views) {
        bytes += size(&view.render)? + size(&view.truth)?;
        if bytes > MAX_BYTES {
            break;
        }
        let score = |metric: &&Metric| format!("{} {}", metric.descriptor.name, cell(metric, values));
        let scores = metrics.iter().take(4).map(score).collect::<Vec<_>>().join(" · ");
        sliders.push(Slider { name: &view.name, truth: data(&view.truth)?, render: data(&view.render)?, scores });
    }
    let (title, protocol) = (comparison.title, comparison.protocol.to_string());
    Ok(rendered(&ComparisonPage { title, protocol, comparison, metrics: &metrics, sliders }))
}

/// Reads an image into a URL that holds it.
fn data(path: &Path) -> Result<String, ReportError> {
    let bytes = fs::read(path).map_err(ReportError::io("read", path))?;
    let kind = if bytes.starts_with(&[0x89, b'P']) { "png" } else { "jpeg" };
    Ok(format!("data:image/{kind};base64,{}", BASE64_STANDARD.encode(bytes)))
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
