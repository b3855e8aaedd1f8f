//! Tables of a page.

use crate::{
    Quantity, Run, Table,
    contents::ReportContents,
    table::measured,
    text::{escape_html, html_prose},
};

/// Note below a table with green cells.
const CLEAR: &str = "Green: the best, and its 95 % interval over seeds overlaps that of no other.";

/// Lays out a comparison table with its title above; the protocol stands above all tables of the page.
pub(super) fn table(table: &Table) -> String {
    let headings = table.names().chain(table.columns.iter().map(|column| column.heading.as_str())).map(heading);
    let rows = table.rows.iter().map(|row| {
        let cells = row.cells.iter().enumerate().map(|(column, cell)| {
            let text = escape_html(&table.text(cell, column));
            let class = match (cell.best, cell.clear) {
                (_, true) => " class=\"best clear\"",
                (true, _) => " class=\"best\"",
                _ => "",
            };
            format!("<td{class}>{text}</td>")
        });
        let names = row.names().map(|name| format!("<th scope=\"row\">{}</th>", escape_html(name)));
        format!("<tr>{}{}</tr>\n", names.collect::<String>(), cells.collect::<String>())
    });
    let clear = table.rows.iter().flat_map(|row| &row.cells).any(|cell| cell.clear).then_some(CLEAR);
    let footnotes = table.footnotes().into_iter().chain(clear);
    let footnotes = footnotes.map(|note| format!("<p class=\"muted\">{}</p>\n", html_prose(note)));
    format!(
        "<div class=\"scroll\"><table>\n<caption>{}</caption>\n\
         <thead><tr>{}</tr></thead>\n<tbody>\n{}</tbody>\n</table></div>\n{}",
        escape_html(&table.title),
        headings.collect::<String>(),
        rows.collect::<String>(),
        footnotes.collect::<String>(),
    )
}

/// Lays out a column's heading, its arrow on the same line as the word before.
fn heading(text: &str) -> String {
    let text = escape_html(text).replace(" ↑", "\u{a0}↑").replace(" ↓", "\u{a0}↓").replace(" → ", "\u{a0}→\u{a0}");
    format!("<th scope=\"col\">{text}</th>")
}

/// Maximum number of runs that are listed.
const MAX_RUNS: usize = 1000;

/// Lists every run with every quantity that any run has.
pub(super) fn runs(contents: &ReportContents) -> String {
    let runs = &contents.runs;
    let quantities: Vec<Quantity> = Quantity::all().into_iter().filter(|&quantity| measured(runs, quantity)).collect();
    let headings: String = quantities.iter().map(|quantity| heading(&quantity.heading())).collect();
    let rows: String = runs.iter().take(MAX_RUNS).map(|run| row(run, &quantities)).collect();
    let more = match runs.len().saturating_sub(MAX_RUNS) {
        0 => String::new(),
        more => format!("<p class=\"muted\">{more} more are in results.json.</p>\n"),
    };
    format!(
        "<section id=\"runs\">\n<h2>Runs</h2>\n<div class=\"scroll\"><table class=\"runs\">\n<thead><tr>\
         <th scope=\"col\">Scene</th><th scope=\"col\">Variant</th><th scope=\"col\">Seed</th>\
         <th scope=\"col\">Steps</th>{headings}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table></div>\n{more}</section>\n"
    )
}

fn row(run: &Run, quantities: &[Quantity]) -> String {
    let record = &run.record;
    let cell = |quantity: &Quantity| match quantity.value(record) {
        Some(value) => format!("<td>{}</td>", quantity.format(value)),
        None => "<td>–</td>".to_owned(),
    };
    format!(
        "<tr><th scope=\"row\">{}</th><td class=\"name\">{}{}</td><td>{}</td><td>{}</td>{}</tr>\n",
        escape_html(&record.scene),
        escape_html(&record.label()),
        if record.collapsed { " <span class=\"tag\">collapsed</span>" } else { "" },
        record.seed,
        record.iterations,
        quantities.iter().map(cell).collect::<String>(),
    )
}
