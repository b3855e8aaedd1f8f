//! Comparison of other programs' renders with the truth, as `infonerf eval --renders` writes it.

use std::fs;
use std::path::{Path, PathBuf};

use askama::Template;
use base64::prelude::{BASE64_STANDARD, Engine};
use image::ImageFormat;
use indexmap::IndexMap;
use infonerf_metrics::{ComparedFolders, METRICS, Metric, Note, Protocol, Values};
use serde::Serialize;

use crate::error::ReportError;
use crate::files::{png_bytes, write_atomically};
use crate::report::rendered;
use crate::text_table::TextTable;

/// Maximum number of bytes of a comparison's images: browsers would take long to open more.
const MAX_BYTES: u64 = 96 << 20;

/// Metrics of two folders of images, with the images.
#[derive(Debug, Clone, Copy)]
pub struct PictureComparison<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// Protocol of the metrics.
    pub protocol: &'a Protocol,
    /// Metrics and paths of the views.
    pub compared: &'a ComparedFolders,
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

/// View with a slider between render and truth, both of which are data URLs.
struct Slider<'a> {
    name: &'a str,
    truth: String,
    render: String,
    scores: String,
}

#[derive(Serialize)]
struct ComparisonJson<'a> {
    evaluation: String,
    protocol: &'a Protocol,
    mean: &'a Values,
    views: IndexMap<&'a str, &'a Values>,
    notes: &'a [Note],
}

impl<'a> PictureComparison<'a> {
    /// Writes `comparison.json`, which has every number, and `comparison.html`, a table and images with a slider between render
    /// and truth, into `folder`. Returns their paths.
    ///
    /// # Errors
    /// If a file cannot be written, or an image cannot be read again.
    pub fn write(&self, folder: &Path) -> Result<[PathBuf; 2], ReportError> {
        let [json, html] = ["comparison.json", "comparison.html"].map(|name| folder.join(name));
        let measured = self.compared.measured.clone().representable();
        let names = self.compared.views.iter().map(|view| view.name.as_str());
        let numbers = ComparisonJson {
            evaluation: self.protocol.to_string(),
            protocol: self.protocol,
            mean: &measured.set,
            views: names.zip(&measured.views).collect(),
            notes: &measured.notes,
        };
        let text = serde_json::to_string_pretty(&numbers).expect("numbers and text are representable");
        write_atomically(&json, text.as_bytes())?;
        write_atomically(&html, comparison_page(self)?.as_bytes())?;
        Ok([json, html])
    }

    /// Formats the protocol, a row per view, the mean, and the notes as plain text.
    pub fn to_text(&self) -> String {
        let metrics = self.metrics();
        let line = |first: &str, cell: &dyn Fn(&&Metric) -> String| {
            [first.to_owned()].into_iter().chain(metrics.iter().map(cell)).collect::<Vec<String>>()
        };
        let mut lines = vec![line("", &|metric| metric.descriptor.heading())];
        lines.extend(self.rows().map(|(name, values)| line(name, &|metric| cell(metric, values))));
        let notes = self.compared.measured.notes.iter().map(|note| format!("{note}\n")).collect::<String>();
        format!("{}\n{}{notes}", self.protocol, TextTable(lines).to_text())
    }

    fn metrics(&self) -> Vec<&'static Metric> {
        let has = |metric: &&&Metric| self.compared.measured.set.get(metric.key()).copied().flatten().is_some();
        METRICS.iter().filter(has).copied().collect()
    }

    fn rows(&self) -> impl Iterator<Item = (&'a str, &'a Values)> {
        let ComparedFolders { views, measured } = self.compared;
        let views = views.iter().map(|view| view.name.as_str()).zip(&measured.views);
        views.chain(std::iter::once(("mean", &measured.set)))
    }
}

/// Makes the page of other programs' renders, with the first views whose images take at most `MAX_BYTES`.
fn comparison_page(comparison: &PictureComparison) -> Result<String, ReportError> {
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

/// Reads an image as a data URL; a TIFF, which browsers do not show, becomes a PNG of 8 bits.
fn data(path: &Path) -> Result<String, ReportError> {
    let bytes = fs::read(path).map_err(ReportError::io("read", path))?;
    let format = image::guess_format(&bytes).map_err(ReportError::io("read", path))?;
    if format != ImageFormat::Tiff {
        return Ok(format!("data:{};base64,{}", format.to_mime_type(), BASE64_STANDARD.encode(bytes)));
    }
    let image = image::load_from_memory(&bytes);
    let png = image.and_then(|image| png_bytes(&image.to_rgba8().into())).map_err(ReportError::io("read", path))?;
    Ok(format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png)))
}

fn cell(metric: &Metric, values: &Values) -> String {
    let value = values.get(metric.key()).copied().flatten();
    value.map_or_else(|| "–".to_owned(), |value| metric.descriptor.format(value))
}
