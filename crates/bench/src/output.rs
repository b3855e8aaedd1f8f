//! Output of benchmarks: text tables, CSV, JSON and charts.

use std::fs;

use anyhow::{Context, Result};
use infonerf_experiment::save_png;
use infonerf_report::chart::{Drawing, standalone};
use serde::Serialize;
use serde_json::Value;

use crate::context::{Bench, Conditions};

/// Content of a benchmark's `results.json`.
#[derive(Serialize)]
struct ResultsFile<'a, R> {
    #[serde(rename = "about")]
    conditions: &'a Conditions,
    /// Description of the measurement.
    protocol: &'a str,
    #[serde(flatten)]
    more: Value,
    rows: &'a [R],
}

impl Bench {
    /// Writes `rows` to `results.json`, with the machine, the description `protocol` and the fields of `more`.
    pub(crate) fn save_results<R: Serialize>(&self, protocol: &str, rows: &[R], more: Value) -> Result<()> {
        let json = serde_json::to_string_pretty(&ResultsFile { conditions: &self.conditions, protocol, more, rows })?;
        self.save("results.json", &(json + "\n"))
    }

    /// Writes a chart as SVG.
    pub(crate) fn save_chart(&self, name: &str, svg: &str) -> Result<()> {
        self.save(&format!("{name}.svg"), &standalone(svg))
    }

    /// Writes a chart as SVG and PNG.
    pub(crate) fn save_drawing(&self, name: &str, drawing: &Drawing) -> Result<()> {
        self.save_chart(name, &drawing.svg)?;
        save_png(&drawing.picture, &self.folder.join(format!("{name}.png")))
    }

    /// Writes a table as CSV, named after the benchmark.
    pub(crate) fn save_csv(&self, table: &TextTable) -> Result<()> {
        self.save(&format!("{}.csv", self.conditions.benchmark), &table.to_csv())
    }

    fn save(&self, name: &str, text: &str) -> Result<()> {
        let path = self.folder.join(name);
        fs::create_dir_all(&self.folder).with_context(|| self.folder.display().to_string())?;
        fs::write(&path, text).with_context(|| path.display().to_string())
    }
}

/// Heading and cells of a column of a table of `R`.
pub(crate) type Column<R> = (&'static str, fn(&R) -> String);

/// Cells of text below headings.
pub(crate) struct TextTable(Vec<Vec<String>>);

impl TextTable {
    /// Builds a table with a line per row.
    pub(crate) fn new<'a, R: 'a>(rows: impl IntoIterator<Item = &'a R>, columns: &[Column<R>]) -> Self {
        let headings = columns.iter().map(|(heading, _)| (*heading).to_owned()).collect();
        let cells = |row| columns.iter().map(|(_, cell)| cell(row)).collect();
        Self(std::iter::once(headings).chain(rows.into_iter().map(cells)).collect())
    }

    /// Appends a column with the cell of each row.
    pub(crate) fn push_column(&mut self, heading: &str, cells: impl IntoIterator<Item = String>) {
        let cells = std::iter::once(heading.to_owned()).chain(cells);
        self.0.iter_mut().zip(cells).for_each(|(line, cell)| line.push(cell));
    }

    /// Formats the table with aligned columns, the first to the left and the others to the right.
    pub(crate) fn to_text(&self) -> String {
        let length = |text: &String| text.chars().count();
        let width = |column| self.0.iter().filter_map(|line| line.get(column)).map(length).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.0[0].len()).map(width).collect();
        let mut text = String::new();
        for line in &self.0 {
            for (column, (cell, width)) in line.iter().zip(&widths).enumerate() {
                let space = " ".repeat(width - length(cell));
                let cell = if column == 0 { format!("{cell}{space}") } else { format!("  {space}{cell}") };
                text.push_str(&cell);
            }
            text.truncate(text.trim_end().len());
            text.push('\n');
        }
        text
    }

    /// Formats the table as comma-separated values (RFC 4180).
    fn to_csv(&self) -> String {
        let quoted = |cell: &String| {
            if cell.contains([',', '"', '\n', '\r']) {
                format!("\"{}\"", cell.replace('"', "\"\""))
            } else {
                cell.clone()
            }
        };
        self.0.iter().map(|cells| cells.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n").collect()
    }
}

/// Formats a value, or `-` if it was not measured.
pub(crate) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
}

/// Computes the median of `values`; 0 for none.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => 0.0,
        n if n % 2 == 0 => 0.5 * (sorted[middle - 1] + sorted[middle]),
        _ => sorted[middle],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_align_columns_and_quote_csv() {
        let rows = [("a, b", 3), ("c", 12)];
        let mut table = TextTable::new(&rows, &[("what", |row: &(&str, i32)| row.0.to_owned())]);
        table.push_column("how many", rows.map(|row| row.1.to_string()));
        assert_eq!(table.to_text(), "what  how many\na, b         3\nc           12\n");
        assert_eq!(table.to_csv(), "what,how many\n\"a, b\",3\nc,12\n");
    }

    #[test]
    fn medians_of_even_counts_are_means_of_two() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&[]), 0.0);
    }
}
