use super::{Cell, Table};
use crate::text::escape_markdown;

impl Table {
    /// Formats GitHub-flavoured Markdown: title, protocol, table with the best in bold, footnotes.
    pub fn to_markdown(&self) -> String {
        let mut lines = vec![format!("**{}**", escape_markdown(&self.title)), String::new()];
        lines.extend(self.protocol.iter().map(|line| format!("> {}  ", escape_markdown(line))));
        if !self.protocol.is_empty() {
            lines.push(String::new());
        }

        let headings = self.columns.iter().map(|column| escape_markdown(&column.heading));
        lines.push(row(self.names(), headings));
        let numbers = self.keys.len() + self.columns.len();
        lines.push(row(std::iter::once("---"), std::iter::repeat_n("---:".to_owned(), numbers)));
        for table_row in &self.rows {
            let cells = table_row.cells.iter().enumerate().map(|(column, cell)| self.markdown(cell, column));
            lines.push(row(table_row.names(), cells));
        }
        for footnote in self.footnotes() {
            lines.extend([String::new(), escape_markdown(footnote)]);
        }
        lines.join("\n") + "\n"
    }

    fn markdown(&self, cell: &Cell, column: usize) -> String {
        let text = self.text(cell, column);
        if cell.best { format!("**{text}**") } else { text }
    }
}

fn row<'a>(names: impl Iterator<Item = &'a str>, rest: impl Iterator<Item = String>) -> String {
    let cells: Vec<String> = names.map(escape_markdown).chain(rest).collect();
    format!("| {} |", cells.join(" | "))
}

#[cfg(test)]
mod tests {
    use crate::{Quantity, scene_table, table::tests::two_by_two};

    #[test]
    fn markdown_has_the_protocol_above_the_table() {
        let expected = "\
**PSNR (dB) ↑**

> train views 26, 86, 2, 55 · test views every-8 (25) · 400 × 400 pixels · seeds 0, 1  
> preset fast · 1000 iterations · device flex  

| variant | lego | mic | mean |
| --- | ---: | ---: | ---: |
| nerf | 16.50 ± 0.71 | 17.50 ± 0.71 | 17.00 ± 0.71 |
| infonerf | **18.50 ± 0.71** | **19.50 ± 0.71** | **19.00 ± 0.71** |
";
        assert_eq!(scene_table(&two_by_two(), Quantity::PSNR).to_markdown(), expected);
    }
}
