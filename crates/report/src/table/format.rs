//! Tables as Markdown, LaTeX, CSV and text.

use super::{Cell, Table, TableRow};
use crate::text::{counted, escape_latex, escape_markdown, plain};
use crate::text_table::TextTable;

impl Table {
    /// Formats GitHub-flavoured Markdown: title, protocol, table with the best in bold, footnotes.
    pub fn to_markdown(&self) -> String {
        let mut lines = vec![format!("**{}**", escape_markdown(&self.title)), String::new()];
        lines.extend(self.protocol.iter().map(|line| format!("> {}  ", escape_markdown(line))));
        lines.extend((!self.protocol.is_empty()).then(String::new));
        let cell = |text: String, best: bool| if best { format!("**{text}**") } else { text };
        let rows = self.formatted(escape_markdown, cell).into_iter();
        lines.extend(rows.map(|cells| format!("| {} |", cells.join(" | "))));
        let rule = "| --- |".to_owned() + &" ---: |".repeat(self.keys.len() + self.columns.len());
        lines.insert(lines.len() - self.rows.len(), rule);
        lines.extend(self.footnotes().into_iter().flat_map(|note| [String::new(), escape_markdown(note)]));
        lines.join("\n") + "\n"
    }

    /// Formats a `tabular` for LaTeX's package booktabs, with the best in bold; title, protocol and footnotes are comments.
    pub fn to_latex(&self) -> String {
        let comment = |line: &str| format!("% {}\n", plain(line));
        let above: String = std::iter::once(&self.title).chain(&self.protocol).map(|line| comment(line)).collect();
        let cell = |text: String, best: bool| match escape_latex(&text) {
            text if best => format!("\\textbf{{{text}}}"),
            text => text,
        };
        let mut rows = self.formatted(escape_latex, cell).into_iter().map(|cells| cells.join(" & ") + " \\\\\n");
        let (heading, columns) = (rows.next().unwrap_or_default(), "r".repeat(self.keys.len() + self.columns.len()));
        let below: String = self.footnotes().into_iter().map(comment).collect();
        format!(
            "{above}\\begin{{tabular}}{{l{columns}}}\n\\toprule\n{heading}\\midrule\n{}\\bottomrule\n\\end{{tabular}}\n{below}",
            rows.collect::<String>()
        )
    }

    /// Formats comma-separated values at full precision (RFC 4180 quoting): for each column its mean, standard
    /// deviation and number of seeds; title and protocol above, in lines that start with `#`. Missing values are empty.
    pub fn to_csv(&self) -> String {
        let comments = std::iter::once(&self.title).chain(&self.protocol).map(|line| format!("# {}\n", plain(line)));
        let headings = self.columns.iter().flat_map(|column| ["", " std", " n"].map(|of| column.heading.clone() + of));
        let mut rows = vec![self.names().map(str::to_owned).chain(headings).collect()];
        for row in &self.rows {
            let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let cells = row.cells.iter().flat_map(|Cell { summary, .. }| {
                let seeds = summary.map_or(0, |summary| summary.n);
                [number(summary.map(|of| of.mean)), number(summary.and_then(|of| of.std)), seeds.to_string()]
            });
            rows.push(row.names().map(str::to_owned).chain(cells).collect());
        }
        comments.collect::<String>() + &TextTable(rows).to_csv()
    }

    /// Formats aligned columns for a terminal, protocol above, with a star after the best value of each column.
    pub fn to_text(&self) -> String {
        let grid = self.grid();
        let rule = "─".repeat(total(&grid.widths()));
        let mut lines: Vec<_> = std::iter::once(&self.title).chain(&self.protocol).map(|line| plain(line)).collect();
        let mut rows = grid.lines().into_iter();
        lines.extend(std::iter::once(rule.clone()).chain(rows.next()).chain([rule.clone()]).chain(rows).chain([rule]));
        let has_star = self.rows.iter().flat_map(|row| &row.cells).any(|cell| cell.best);
        lines.extend(has_star.then(|| "* best of its column".to_owned()));
        lines.extend(self.footnotes().into_iter().map(str::to_owned));
        lines.join("\n") + "\n"
    }

    /// Returns the table with as many columns of numbers as [`Table::to_text`] can put into `width` characters, the
    /// most important first, and a note of the number left out.
    pub fn narrowed(&self, width: usize) -> Self {
        let widths = self.grid().widths();
        let (names, numbers) = widths.split_at(1 + self.keys.len());
        let mut by_rank: Vec<usize> = (0..self.columns.len()).collect();
        by_rank.sort_by_key(|&column| self.columns[column].rank());
        let (mut left, mut kept) = (width.saturating_sub(total(names)), Vec::new());
        for column in by_rank {
            let Some(rest) = left.checked_sub(2 + numbers[column]) else { break };
            left = rest;
            kept.push(column);
        }
        kept.sort_unstable();
        let left_out = self.columns.len() - kept.len();
        let note = (left_out > 0).then(|| format!("{} in report.html", counted(left_out, "more column")));
        let cells = |row: &TableRow| kept.iter().filter_map(|&column| row.cells.get(column).copied()).collect();
        Self {
            columns: kept.iter().map(|&column| self.columns[column].clone()).collect(),
            rows: self.rows.iter().map(|row| TableRow { cells: cells(row), ..row.clone() }).collect(),
            notes: self.notes.iter().cloned().chain(note).collect(),
            ..self.clone()
        }
    }

    /// Formats the cells as text; values of a column that has a best one align by a place for the star.
    fn grid(&self) -> TextTable {
        let mut grid = TextTable(self.formatted(plain, |text, best| if best { text + "*" } else { text }));
        for column in 0..self.columns.len() {
            let best = |row: &TableRow| row.cells.get(column).is_some_and(|cell| cell.best);
            if self.rows.iter().any(best) {
                for (line, _) in grid.0[1..].iter_mut().zip(&self.rows).filter(|(_, row)| !best(row)) {
                    line[1 + self.keys.len() + column].push(' ');
                }
            }
        }
        grid
    }

    /// Formats the cells, headings first: names by `name`, values by `value`, which is given whether they are the best.
    fn formatted(&self, name: fn(&str) -> String, value: impl Fn(String, bool) -> String) -> Vec<Vec<String>> {
        let headings = self.names().chain(self.columns.iter().map(|column| column.heading.as_str())).map(name);
        let row = |row: &TableRow| {
            let cells = self.cells(row).map(|(cell, text)| value(text, cell.best));
            row.names().map(name).chain(cells).collect()
        };
        std::iter::once(headings.collect()).chain(self.rows.iter().map(row)).collect()
    }
}

/// Returns the number of characters of columns with two spaces between.
fn total(widths: &[usize]) -> usize {
    widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1)
}

#[cfg(test)]
mod tests {
    use crate::quantity::Quantity;
    use crate::table::{scene_table, tests::record, tests::two_by_two};

    #[test]
    fn protocol_stands_above_the_best_in_bold() {
        let table = scene_table(&two_by_two(), Quantity::PSNR);
        let expected = "\
**PSNR (dB) ↑**

> train views 26, 86, 2, 55 · test views every-8 (25) · 400 × 400 pixels · seeds 0, 1  
> preset fast · 1000 iterations · device flex  

| variant | lego | mic | mean |
| --- | ---: | ---: | ---: |
| nerf | 16.50 ± 0.71 | 17.50 ± 0.71 | 17.00 ± 0.71 |
| infonerf | **18.50 ± 0.71** | **19.50 ± 0.71** | **19.00 ± 0.71** |
";
        assert_eq!(table.to_markdown(), expected);
        let expected = "\
PSNR (dB) ↑
train views 26, 86, 2, 55 · test views every-8 (25) · 400 × 400 pixels · seeds 0, 1
preset fast · 1000 iterations · device flex
─────────────────────────────────────────────────────
variant            lego            mic           mean
─────────────────────────────────────────────────────
nerf      16.50 ± 0.71   17.50 ± 0.71   17.00 ± 0.71
infonerf  18.50 ± 0.71*  19.50 ± 0.71*  19.00 ± 0.71*
─────────────────────────────────────────────────────
* best of its column
";
        assert_eq!(table.to_text(), expected);
    }

    #[test]
    fn latex_escapes_names_and_prints_the_best_in_bold() {
        let records = [record("lego", "no_kl", 0, 16.5), record("lego", "λ₁ 50 %", 0, 17.25)];
        let expected = r"% PSNR (dB) ↑
% train views 26, 86, 2, 55 · test views every-8 (25) · 400 × 400 pixels · seed 0
% preset fast · 1000 iterations · device flex
\begin{tabular}{lr}
\toprule
variant & lego \\
\midrule
no\_kl & 16.50 \\
$\lambda$$_1$ 50 \% & \textbf{17.25} \\
\bottomrule
\end{tabular}
";
        assert_eq!(scene_table(&records, Quantity::PSNR).to_latex(), expected);
    }

    #[test]
    fn csv_keeps_full_precision_and_quotes() {
        let records = [record("a_,b", "nerf", 0, 16.123456789), record("a_,b", "info\"nerf", 0, 17.0)];
        let csv = scene_table(&records, Quantity::PSNR).to_csv();
        let body: Vec<&str> = csv.lines().filter(|line| !line.starts_with('#')).collect();
        let expected = ["variant,\"a_,b\",\"a_,b std\",\"a_,b n\"", "nerf,16.123456789,,1", "\"info\"\"nerf\",17,,1"];
        assert_eq!(body, expected);
    }

    #[test]
    fn narrow_table_keeps_the_most_important_columns() {
        let wide = scene_table(&two_by_two(), Quantity::PSNR);
        assert_eq!(wide.narrowed(53), wide);
        let narrow = wide.narrowed(52);
        let headings: Vec<&str> = narrow.columns.iter().map(|column| column.heading.as_str()).collect();
        assert_eq!(headings, ["lego", "mean"]);
        let end = "19.00 ± 0.71*\n──────────────────────────────────────\n* best of its column\n1 more column in report.html\n";
        assert!(narrow.to_text().ends_with(end));
        assert!(wide.narrowed(0).columns.is_empty());
    }
}
