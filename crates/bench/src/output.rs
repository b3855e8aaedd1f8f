//! Output of benchmarks: text tables, CSV, JSON and charts.

use std::fs;

use anyhow::{Context, Result};
use infonerf_experiment::save_png;
use infonerf_report::chart::{Drawing, standalone};
use serde::Serialize;

use super::context::{About, Bench};

/// A benchmark's `results.json`.
#[derive(Serialize)]
struct Results<'a, T> {
    about: &'a About,
    /// What was done, in words.
    protocol: &'a str,
    #[serde(flatten)]
    results: &'a T,
}

impl Bench {
    /// Writes `results.json`: the machine, how it was measured, and `results`.
    pub(super) fn save_results(&self, protocol: &str, results: &impl Serialize) -> Result<()> {
        let json = serde_json::to_string_pretty(&Results { about: &self.about, protocol, results })?;
        self.save("results.json", &(json + "\n"))
    }

    /// Writes a chart as a file of its own.
    pub(super) fn save_chart(&self, name: &str, svg: &str) -> Result<()> {
        self.save(&format!("{name}.svg"), &standalone(svg))
    }

    /// Writes a chart as a file of its own, and as a picture.
    pub(super) fn save_drawing(&self, name: &str, drawing: &Drawing) -> Result<()> {
        self.save_chart(name, &drawing.svg)?;
        save_png(&drawing.picture, &self.folder.join(format!("{name}.png")))
    }

    /// Writes a table for other programs.
    pub(super) fn save_csv(&self, name: &str, table: &TextTable) -> Result<()> {
        self.save(&format!("{name}.csv"), &table.to_csv())
    }

    fn save(&self, name: &str, text: &str) -> Result<()> {
        let path = self.folder.join(name);
        fs::create_dir_all(&self.folder).with_context(|| self.folder.display().to_string())?;
        fs::write(&path, text).with_context(|| path.display().to_string())
    }
}

/// Cells of text below headings.
pub(super) struct TextTable {
    headings: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl TextTable {
    pub(super) fn new(headings: &[&str]) -> Self {
        Self { headings: headings.iter().map(|&heading| heading.to_owned()).collect(), rows: Vec::new() }
    }

    pub(super) fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// Aligned columns, the first to the left and the others to the right.
    pub(super) fn to_text(&self) -> String {
        let length = |text: &String| text.chars().count();
        let lines = || std::iter::once(&self.headings).chain(&self.rows);
        let width = |column| lines().filter_map(|line| line.get(column)).map(length).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.headings.len()).map(width).collect();
        let mut text = String::new();
        for line in lines() {
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

    /// Comma-separated values (RFC 4180).
    fn to_csv(&self) -> String {
        let quoted = |cell: &String| {
            if cell.contains([',', '"', '\n', '\r']) {
                format!("\"{}\"", cell.replace('"', "\"\""))
            } else {
                cell.clone()
            }
        };
        let line = |cells: &Vec<String>| cells.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n";
        std::iter::once(&self.headings).chain(&self.rows).map(line).collect()
    }
}

/// A number that may not have been measured.
pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
}

/// The median of `values`; 0 for none.
pub(super) fn median(values: &[f64]) -> f64 {
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
    fn tables() {
        let mut table = TextTable::new(&["what", "how many"]);
        table.row(vec!["a, b".into(), "3".into()]);
        table.row(vec!["c".into(), "12".into()]);
        assert_eq!(table.to_text(), "what  how many\na, b         3\nc           12\n");
        assert_eq!(table.to_csv(), "what,how many\n\"a, b\",3\nc,12\n");
    }

    #[test]
    fn medians() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&[]), 0.0);
    }
}
