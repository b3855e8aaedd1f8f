use super::{Cell, Table, TableRow};
use crate::text::plain;

/// Mark of the best of a column in [`Table::to_text`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emphasis {
    /// Bold, by terminal escape codes.
    Terminal,
    /// `*` after the value, for files and pipes.
    Star,
}

impl Table {
    /// Formats aligned columns for a terminal, protocol above.
    pub fn to_text(&self, emphasis: Emphasis) -> String {
        let grid = self.grid(emphasis);
        let widths = widths(&grid);
        let mut lines: Vec<String> =
            std::iter::once(&self.title).chain(&self.protocol).map(|line| plain(line)).collect();
        let rule = "─".repeat(total(&widths));
        for (index, row) in grid.iter().enumerate() {
            if index <= 1 {
                lines.push(rule.clone());
            }
            let bold = |column: usize| {
                let cell = |row: &TableRow| row.cells.get(column.checked_sub(1 + self.keys.len())?).copied();
                let cell = index.checked_sub(1).and_then(|index| self.rows.get(index)).and_then(cell);
                emphasis == Emphasis::Terminal && cell.is_some_and(|cell| cell.best)
            };
            let cells = row.iter().zip(&widths).enumerate().map(|(column, (text, &width))| {
                let space = " ".repeat(width.saturating_sub(length(text)));
                let text = if bold(column) { format!("\u{1b}[1m{text}\u{1b}[0m") } else { text.clone() };
                if column == 0 { text + &space } else { space + &text }
            });
            lines.push(cells.collect::<Vec<_>>().join("  ").trim_end().to_owned());
        }
        lines.push(rule);
        lines.extend(self.footnotes().into_iter().map(str::to_owned));
        lines.join("\n") + "\n"
    }

    /// Returns the table with as many columns of numbers as [`Table::to_text`] can put into `width` characters, the
    /// most important first, and a note of the number left out.
    #[must_use]
    pub fn narrowed(&self, width: usize) -> Self {
        let widths = widths(&self.grid(Emphasis::Star));
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
        let note = match left_out {
            0 => None,
            1 => Some("1 more column is in report.html".into()),
            _ => Some(format!("{left_out} more columns are in report.html")),
        };
        let cells = |row: &TableRow| kept.iter().filter_map(|&column| row.cells.get(column).copied()).collect();
        Self {
            columns: kept.iter().map(|&column| self.columns[column].clone()).collect(),
            rows: self.rows.iter().map(|row| TableRow { cells: cells(row), ..row.clone() }).collect(),
            notes: self.notes.iter().cloned().chain(note).collect(),
            ..self.clone()
        }
    }

    /// Formats the cells, headings first.
    fn grid(&self, emphasis: Emphasis) -> Vec<Vec<String>> {
        let headings = self.names().chain(self.columns.iter().map(|column| column.heading.as_str())).map(plain);
        let row = |row: &TableRow| {
            let cells = row.cells.iter().enumerate().map(|(column, cell)| self.plain(cell, column, emphasis));
            row.names().map(plain).chain(cells).collect()
        };
        std::iter::once(headings.collect()).chain(self.rows.iter().map(row)).collect()
    }

    /// Formats a cell. With [`Emphasis::Star`] every value of a column with a best keeps a place for the star, so that
    /// decimals align.
    fn plain(&self, cell: &Cell, column: usize, emphasis: Emphasis) -> String {
        let text = self.text(cell, column);
        let starred = self.rows.iter().filter_map(|row| row.cells.get(column)).any(|cell| cell.best);
        match (emphasis, starred) {
            (Emphasis::Star, true) => text + if cell.best { "*" } else { " " },
            _ => text,
        }
    }
}

/// Returns the number of characters of each column.
fn widths(grid: &[Vec<String>]) -> Vec<usize> {
    let width = |column: usize| grid.iter().filter_map(|row| row.get(column)).map(|text| length(text)).max();
    (0..grid[0].len()).map(|column| width(column).unwrap_or(0)).collect()
}

/// Returns the number of characters of columns with two spaces between.
fn total(widths: &[usize]) -> usize {
    widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1)
}

fn length(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use crate::{Emphasis, Quantity, scene_table, table::tests::two_by_two};

    #[test]
    fn text_is_aligned() {
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
";
        assert_eq!(scene_table(&two_by_two(), Quantity::PSNR).to_text(Emphasis::Star), expected);
    }

    #[test]
    fn narrow_table_keeps_the_most_important_columns() {
        let wide = scene_table(&two_by_two(), Quantity::PSNR);
        assert_eq!(wide.narrowed(53), wide);
        let narrow = wide.narrowed(52);
        let headings: Vec<&str> = narrow.columns.iter().map(|column| column.heading.as_str()).collect();
        assert_eq!(headings, ["lego", "mean"]);
        assert!(
            narrow
                .to_text(Emphasis::Star)
                .ends_with("19.00 ± 0.71*\n──────────────────────────────────────\n1 more column is in report.html\n")
        );
        assert!(wide.narrowed(0).columns.is_empty());
    }

    #[test]
    fn best_is_bold_in_a_terminal() {
        let text = scene_table(&two_by_two(), Quantity::PSNR).to_text(Emphasis::Terminal);
        assert!(text.contains("\u{1b}[1m18.50 ± 0.71\u{1b}[0m"), "{text}");
    }
}
