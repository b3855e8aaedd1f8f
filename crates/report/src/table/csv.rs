use super::Table;
use crate::text::plain;

impl Table {
    /// Formats comma-separated values at full precision (RFC 4180 quoting): for each column its mean, standard
    /// deviation and number of seeds; title and protocol above, in lines that start with `#`. Missing values are empty.
    pub fn to_csv(&self) -> String {
        let mut lines: Vec<String> =
            std::iter::once(&self.title).chain(&self.protocol).map(|line| format!("# {}", plain(line))).collect();
        let headings = self.columns.iter().flat_map(|column| {
            [column.heading.clone(), format!("{} std", column.heading), format!("{} n", column.heading)]
        });
        lines.push(line(self.names(), headings));
        for row in &self.rows {
            let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let cells = row.cells.iter().flat_map(|cell| match cell.summary {
                Some(summary) => [number(Some(summary.mean)), number(summary.std), summary.n.to_string()],
                None => [String::new(), String::new(), "0".to_owned()],
            });
            lines.push(line(row.names(), cells));
        }
        lines.join("\n") + "\n"
    }
}

fn line<'a>(names: impl Iterator<Item = &'a str>, rest: impl Iterator<Item = String>) -> String {
    names.map(str::to_owned).chain(rest).map(|field| quoted(&field)).collect::<Vec<_>>().join(",")
}

fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r', '#']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use crate::{Quantity, scene_table, table::tests::record};

    #[test]
    fn csv_keeps_full_precision_and_quotes() {
        let records = [record("a,b", "nerf", 0, 16.123456789), record("a,b", "info\"nerf", 0, 17.0)];
        let csv = scene_table(&records, Quantity::PSNR).to_csv();
        let body: Vec<&str> = csv.lines().filter(|line| !line.starts_with('#')).collect();
        let expected = ["variant,\"a,b\",\"a,b std\",\"a,b n\"", "nerf,16.123456789,,1", "\"info\"\"nerf\",17,,1"];
        assert_eq!(body, expected);
    }
}
