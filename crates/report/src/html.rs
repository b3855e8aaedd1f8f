//! `report.html` and the page of several experiments from `templates/`, each one file with its style, charts and images
//! inside.

use askama::Template;

use crate::{colormap::to_bytes, contents::ReportContents, quantity::Quantity, record::Record};

#[derive(Template)]
#[template(path = "report.html")]
pub(crate) struct ReportPage<'a> {
    pub(crate) title: String,
    pub(crate) contents: &'a ReportContents<'a>,
    /// Quantities that any run has.
    pub(crate) quantities: Vec<Quantity>,
}

#[derive(Template)]
#[template(path = "collection.html")]
pub(crate) struct CollectionPage<'a> {
    pub(crate) title: &'a str,
    pub(crate) introduction: &'a str,
    pub(crate) chapters: &'a [ReportContents<'a>],
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
