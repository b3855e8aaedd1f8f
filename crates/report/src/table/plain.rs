use super::{Cell, Table};
use crate::text::plain;

/// How [`Table::to_text`] marks the best of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emphasis {
    /// Bold by terminal escape codes.
    Terminal,
    /// A `*` after the value, for files and pipes.
    Star,
}

impl Table {
    /// Aligned columns for a terminal, protocol above.
    #[must_use]
    pub fn to_text(&self, emphasis: Emphasis) -> String {
        let header = std::iter::once("variant".to_owned()).chain(self.columns.iter().map(|c| plain(&c.heading)));
        let body = self.rows.iter().map(|row| {
            let cells = row.cells.iter().enumerate().map(|(column, cell)| self.plain(cell, column, emphasis));
            std::iter::once(plain(&row.label)).chain(cells).collect()
        });
        let grid: Vec<Vec<String>> = std::iter::once(header.collect()).chain(body).collect();
        let width = |column: usize| grid.iter().filter_map(|row| row.get(column)).map(|text| length(text)).max();
        let widths: Vec<usize> = (0..=self.columns.len()).map(|column| width(column).unwrap_or(0)).collect();

        let mut lines: Vec<String> =
            std::iter::once(&self.title).chain(&self.protocol).map(|line| plain(line)).collect();
        let rule = "─".repeat(widths.iter().sum::<usize>() + 2 * self.columns.len());
        for (index, row) in grid.iter().enumerate() {
            if index <= 1 {
                lines.push(rule.clone());
            }
            let bold = |column: usize| {
                let cell = index.checked_sub(1).and_then(|i| self.rows.get(i)?.cells.get(column.checked_sub(1)?));
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

    /// With [`Emphasis::Star`] every value of a column with a best keeps a place for the star, so that decimals align.
    fn plain(&self, cell: &Cell, column: usize, emphasis: Emphasis) -> String {
        let text = self.text(cell, column);
        let starred = self.rows.iter().filter_map(|row| row.cells.get(column)).any(|cell| cell.best);
        match (emphasis, starred) {
            (Emphasis::Star, true) => text + if cell.best { "*" } else { " " },
            _ => text,
        }
    }
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
    fn a_terminal_sees_bold() {
        let text = scene_table(&two_by_two(), Quantity::PSNR).to_text(Emphasis::Terminal);
        assert!(text.contains("\u{1b}[1m18.50 ± 0.71\u{1b}[0m"), "{text}");
    }
}
