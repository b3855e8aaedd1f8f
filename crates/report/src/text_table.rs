//! Cells of text as aligned columns and as comma-separated values.

/// Column of a text table: its heading, and the function that returns the cell of a row.
pub type TextColumn<R> = (&'static str, fn(&R) -> String);

/// Cells of text below headings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextTable(pub(crate) Vec<Vec<String>>);

impl TextTable {
    /// Builds a table with a line per row.
    pub fn new<'a, R: 'a>(rows: impl IntoIterator<Item = &'a R>, columns: &[TextColumn<R>]) -> Self {
        let headings = columns.iter().map(|(heading, _)| (*heading).to_owned()).collect();
        let cells = |row| columns.iter().map(|(_, cell)| cell(row)).collect();
        Self(std::iter::once(headings).chain(rows.into_iter().map(cells)).collect())
    }

    pub(crate) fn widths(&self) -> Vec<usize> {
        let width = |column: usize| self.0.iter().filter_map(|line| Some(line.get(column)?.chars().count())).max();
        (0..self.0[0].len()).map(|column| width(column).unwrap_or(0)).collect()
    }

    pub(crate) fn lines(&self) -> Vec<String> {
        let widths = self.widths();
        let cell = |(column, (text, width)): (usize, (&String, &usize))| {
            let space = " ".repeat(width - text.chars().count());
            if column == 0 { format!("{text}{space}") } else { format!("{space}{text}") }
        };
        let line = |line: &Vec<String>| {
            let cells: Vec<String> = line.iter().zip(&widths).enumerate().map(cell).collect();
            cells.join("  ").trim_end().to_owned()
        };
        self.0.iter().map(line).collect()
    }

    /// Formats the table with aligned columns, the first to the left and the others to the right.
    pub fn to_text(&self) -> String {
        self.lines().join("\n") + "\n"
    }

    /// Formats the table as comma-separated values (RFC 4180). Cells with `#` are quoted, since comments start with it.
    pub fn to_csv(&self) -> String {
        let quoted = |cell: &String| match cell.contains([',', '"', '\n', '\r', '#']) {
            true => format!("\"{}\"", cell.replace('"', "\"\"")),
            false => cell.clone(),
        };
        self.0.iter().map(|cells| cells.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n").collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_align_columns_and_quote_csv() {
        let rows = [("a, b", 3), ("c", 12)];
        let table = TextTable::new(
            &rows,
            &[("what", |row: &(&str, i32)| row.0.to_owned()), ("how many", |row| row.1.to_string())],
        );
        assert_eq!(table.to_text(), "what  how many\na, b         3\nc           12\n");
        assert_eq!(table.to_csv(), "what,how many\n\"a, b\",3\nc,12\n");
    }
}
