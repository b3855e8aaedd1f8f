//! `report.html`, one file with its style, charts and images inside.

mod claims;
mod collection;
mod comparison;
mod scene;
mod table;

pub(crate) use collection::page as collection_page;
pub(crate) use comparison::comparison_page;

use crate::{
    Figure,
    contents::ReportContents,
    text::{escape_html, html_prose},
};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("compare.js");

pub(crate) fn page(contents: &ReportContents) -> String {
    let sections = [
        results(contents),
        contents.scenes.iter().enumerate().map(scene::section).collect(),
        table::runs(contents),
        notes(contents),
    ];
    document(&contents.input.heading(), &header(contents), &sections.concat())
}

/// Makes a page with its style and script inside. `header` and `main` are HTML, `title` is text.
fn document(title: &str, header: &str, main: &str) -> String {
    let title = escape_html(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{header}<main>\n{main}</main>\n\
         <footer>Every table, chart and image of this page is inside this one file.</footer>\n\
         <script>\n{SCRIPT}</script>\n</body>\n</html>\n"
    )
}

fn header(contents: &ReportContents) -> String {
    let links = contents.scenes.iter().enumerate();
    let links = links.map(|(i, scene)| format!("<a href=\"#{}\">{}</a>", scene::anchor(i), escape_html(&scene.name)));
    format!(
        "<header>\n<p class=\"eyebrow\">{}</p>\n<h1>{}</h1>\n{}\
         <nav><a href=\"#results\">Results</a>{}<a href=\"#runs\">Runs</a><a href=\"#notes\">Notes</a></nav>\n{}</header>\n",
        escape_html(&contents.input.experiment),
        escape_html(&contents.input.heading()),
        protocol(contents),
        links.collect::<String>(),
        warnings(contents),
    )
}

fn warnings(contents: &ReportContents) -> String {
    contents.warnings.iter().map(|warning| format!("<p class=\"warning\">{}</p>\n", html_prose(warning))).collect()
}

/// Lists how the numbers were obtained.
fn protocol(contents: &ReportContents) -> String {
    let parts = contents.protocol.iter().flat_map(|line| line.split(" · "));
    let parts = parts.map(|part| format!("<li>{}</li>", escape_html(part)));
    format!("<ul class=\"protocol\">{}</ul>\n", parts.collect::<String>())
}

fn results(contents: &ReportContents) -> String {
    let more: String = contents.tables.iter().skip(2).map(table::table).collect();
    let more = if more.is_empty() {
        more
    } else {
        format!("<details><summary>Every metric by scene</summary>\n{more}</details>\n")
    };
    format!(
        "<section id=\"results\">\n<h2>Results</h2>\n{}{}{}{}{}{more}</section>\n",
        scene::panel(&contents.scenes),
        contents.overviews.iter().chain(&contents.published).map(table::table).collect::<String>(),
        claims::list(&contents.claims),
        contents.tables.iter().take(2).map(table::table).collect::<String>(),
        figures(&contents.figures),
    )
}

/// Lays out charts side by side.
fn figures(figures: &[Figure]) -> String {
    let figure = |figure: &Figure| {
        let caption = if figure.caption.is_empty() {
            String::new()
        } else {
            format!("<figcaption>{}</figcaption>", html_prose(&figure.caption))
        };
        format!(
            "<figure class=\"chart\" aria-label=\"{}\">\n{}{caption}</figure>\n",
            escape_html(&figure.title),
            figure.svg
        )
    };
    if figures.is_empty() {
        String::new()
    } else {
        format!("<div class=\"charts\">\n{}</div>\n", figures.iter().map(figure).collect::<String>())
    }
}

fn notes(contents: &ReportContents) -> String {
    let item = |note: &str, runs: &str| {
        format!("<li>{} <span class=\"muted\">{}</span></li>\n", html_prose(note), escape_html(runs))
    };
    let notes: String = contents.notes.iter().map(|(note, runs)| item(note, runs)).collect();
    let notes =
        if notes.is_empty() { "<p class=\"muted\">None.</p>\n".to_owned() } else { format!("<ul>\n{notes}</ul>\n") };
    let missing: String = contents.missing.iter().map(|line| item(line, "")).collect();
    let missing = if missing.is_empty() {
        missing
    } else {
        format!("<details><summary>Left out ({})</summary>\n<ul>\n{missing}</ul>\n</details>\n", contents.missing.len())
    };
    format!("<section id=\"notes\">\n<h2>Notes</h2>\n{notes}{missing}</section>\n")
}
