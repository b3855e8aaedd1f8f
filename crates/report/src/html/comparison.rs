//! Page with a table of views, and each render over its truth with a slider between the two.

use std::fs;
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use infonerf_metrics::{ComparedView, Metric, Values};

use crate::comparison::cell;
use crate::{PictureComparison, ReportError, text::escape_html};

/// Maximum number of bytes of a page's images: browsers would take long to open more.
const MAX_BYTES: u64 = 96 << 20;

pub(crate) fn comparison_page(comparison: &PictureComparison<'_>) -> Result<String, ReportError> {
    let metrics = comparison.metrics();
    let views = comparison.compared.views.iter().zip(&comparison.compared.measured.views);
    let (mut figures, mut bytes) = (String::new(), 0);
    let mut left_out = 0;
    for (view, values) in views {
        bytes += size(&view.render)? + size(&view.truth)?;
        if bytes > MAX_BYTES {
            left_out += 1;
            continue;
        }
        figures += &figure(view, &scores(&metrics, values))?;
    }
    if left_out > 0 {
        figures += &format!("<p class=\"muted\">{left_out} further views are in the table alone.</p>\n");
    }
    let notes = comparison.compared.measured.notes.iter();
    let notes: String = notes.map(|note| format!("<li>{}</li>\n", escape_html(&note.to_string()))).collect();
    let main = format!(
        "<section>\n<h2>Results</h2>\n{}{}</section>\n<section>\n<h2>Views</h2>\n\
         <p class=\"muted\">Left of the line the render, right of it the truth.</p>\n<div class=\"sliders\">\n{figures}</div>\n</section>\n",
        table(comparison, &metrics),
        if notes.is_empty() { notes } else { format!("<ul class=\"muted\">\n{notes}</ul>\n") },
    );
    let header = format!(
        "<header>\n<p class=\"eyebrow\">{} views</p>\n<h1>{}</h1>\n<ul class=\"protocol\">{}</ul>\n</header>\n",
        comparison.compared.views.len(),
        escape_html(comparison.title),
        comparison
            .protocol
            .to_string()
            .split("; ")
            .map(|part| format!("<li>{}</li>", escape_html(part)))
            .collect::<String>(),
    );
    Ok(super::document(comparison.title, &header, &main))
}

fn table(comparison: &PictureComparison<'_>, metrics: &[&Metric]) -> String {
    let headings: String =
        metrics.iter().map(|metric| format!("<th>{}</th>", escape_html(&metric.descriptor.heading()))).collect();
    let row = |(name, values): (&str, &Values)| {
        let cells: String = metrics.iter().map(|metric| format!("<td>{}</td>", cell(metric, values))).collect();
        format!("<tr><th>{}</th>{cells}</tr>\n", escape_html(name))
    };
    let rows: String = comparison.rows().map(row).collect();
    format!(
        "<div class=\"scroll\"><table>\n<thead><tr><th></th>{headings}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table></div>\n"
    )
}

/// Formats the first metrics of a view, such as `PSNR 18.92 · SSIM 0.788`.
fn scores(metrics: &[&Metric], values: &Values) -> String {
    let score = |metric: &&Metric| format!("{} {}", metric.descriptor.name, cell(metric, values));
    metrics.iter().take(4).map(score).collect::<Vec<_>>().join(" · ")
}

fn figure(view: &ComparedView, scores: &str) -> Result<String, ReportError> {
    let name = escape_html(&view.name);
    Ok(format!(
        "<figure class=\"slider\">\n<div>\n<img alt=\"truth of {name}\" src=\"{}\">\n<img class=\"over\" alt=\"render of {name}\" src=\"{}\">\n\
         <input type=\"range\" min=\"0\" max=\"100\" value=\"50\" aria-label=\"share of the render\" \
         oninput=\"this.parentElement.style.setProperty('--share', this.value + '%')\">\n</div>\n\
         <figcaption>{name}: {}</figcaption>\n</figure>\n",
        data(&view.truth)?,
        data(&view.render)?,
        escape_html(scores),
    ))
}

fn size(path: &Path) -> Result<u64, ReportError> {
    fs::metadata(path).map(|file| file.len()).map_err(ReportError::io("read", path))
}

fn data(path: &Path) -> Result<String, ReportError> {
    let bytes = fs::read(path).map_err(ReportError::io("read", path))?;
    let kind = if bytes.starts_with(&[0x89, b'P']) { "png" } else { "jpeg" };
    Ok(format!("data:image/{kind};base64,{}", BASE64_STANDARD.encode(bytes)))
}
