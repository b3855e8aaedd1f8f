//! Tables of the page.

use crate::{Quantity, Run, Table, contents::Contents, text::escape_html};

/// A comparison table with its title above; the protocol stands above all tables of the page.
pub(super) fn table(table: &Table) -> String {
    let headings = table.names().chain(table.columns.iter().map(|column| column.heading.as_str())).map(heading);
    let rows = table.rows.iter().map(|row| {
        let cells = row.cells.iter().enumerate().map(|(column, cell)| {
            let text = escape_html(&table.text(cell, column));
            if cell.best { format!("<td class=\"best\">{text}</td>") } else { format!("<td>{text}</td>") }
        });
        let names = row.names().map(|name| format!("<th scope=\"row\">{}</th>", escape_html(name)));
        format!("<tr>{}{}</tr>\n", names.collect::<String>(), cells.collect::<String>())
    });
    let footnotes = table.footnotes().into_iter().map(|note| format!("<p class=\"muted\">{}</p>\n", escape_html(note)));
    format!(
        "<div class=\"scroll\"><table>\n<caption>{}</caption>\n\
         <thead><tr>{}</tr></thead>\n<tbody>\n{}</tbody>\n</table></div>\n{}",
        escape_html(&table.title),
        headings.collect::<String>(),
        rows.collect::<String>(),
        footnotes.collect::<String>(),
    )
}

/// A column's heading, its arrow on the same line as the word before.
fn heading(text: &str) -> String {
    let text = escape_html(text).replace(" ↑", "\u{a0}↑").replace(" ↓", "\u{a0}↓").replace(" → ", "\u{a0}→\u{a0}");
    format!("<th scope=\"col\">{text}</th>")
}

/// Runs that are listed, at most.
const MOST_RUNS: usize = 1000;

/// Every run with every quantity that any run has.
pub(super) fn runs(contents: &Contents) -> String {
    let runs = &contents.input.runs;
    let measured = |quantity: &Quantity| runs.iter().any(|run| quantity.value(&run.record).is_some());
    let quantities: Vec<Quantity> = Quantity::all().into_iter().filter(measured).collect();
    let headings: String = quantities.iter().map(|quantity| heading(&quantity.heading())).collect();
    let rows: String = runs.iter().take(MOST_RUNS).map(|run| row(run, &quantities)).collect();
    let more = match runs.len().saturating_sub(MOST_RUNS) {
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
