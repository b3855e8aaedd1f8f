use super::{Cell, Table};
use crate::text::escape_latex;

impl Table {
    /// Formats a LaTeX `table` for the `booktabs` package, protocol in the caption above the rows.
    pub fn to_latex(&self) -> String {
        let caption: Vec<String> =
            std::iter::once(&self.title).chain(&self.protocol).map(|line| escape_latex(line) + ".").collect();
        let headings = self.columns.iter().map(|column| escape_latex(&column.heading));
        let mut lines = vec![
            r"\begin{table}".to_owned(),
            r"  \centering".to_owned(),
            format!(r"  \caption{{{}}}", caption.join(" ")),
            format!(r"  \begin{{tabular}}{{l{}{}}}", "r".repeat(self.keys.len()), "c".repeat(self.columns.len())),
            r"    \toprule".to_owned(),
            row(self.names(), headings),
            r"    \midrule".to_owned(),
        ];
        for table_row in &self.rows {
            let cells = table_row.cells.iter().enumerate().map(|(column, cell)| self.latex(cell, column));
            lines.push(row(table_row.names(), cells));
        }
        lines.extend([r"    \bottomrule".to_owned(), r"  \end{tabular}".to_owned()]);
        lines.extend(self.footnotes().into_iter().map(|note| format!(r"  \par\footnotesize {}", escape_latex(note))));
        lines.push(r"\end{table}".to_owned());
        lines.join("\n") + "\n"
    }

    fn latex(&self, cell: &Cell, column: usize) -> String {
        let text = escape_latex(&self.text(cell, column));
        if cell.best { format!(r"\textbf{{{text}}}") } else { text }
    }
}

fn row<'a>(names: impl Iterator<Item = &'a str>, rest: impl Iterator<Item = String>) -> String {
    let cells: Vec<String> = names.map(escape_latex).chain(rest).collect();
    format!(r"    {} \\", cells.join(" & "))
}

#[cfg(test)]
mod tests {
    use crate::{Quantity, scene_table, table::tests::record};

    #[test]
    fn latex_sets_the_best_in_bold_and_escapes() {
        let records = [record("my_scene", "nerf", 0, 16.0), record("my_scene", "info_nerf", 0, 17.0)];
        let latex = scene_table(&records, Quantity::PSNR).to_latex();
        assert!(latex.contains(r"    nerf & 16.00 \\"), "{latex}");
        assert!(latex.contains(r"    info\_nerf & \textbf{17.00} \\"), "{latex}");
        assert!(latex.contains(r"\caption{PSNR (dB) $\uparrow$. train views 26, 86, 2, 55 $\cdot$"), "{latex}");
    }
}
