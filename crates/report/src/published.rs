//! A paper's published figures, shown beside ours.

use infonerf_metrics::Summary;

use crate::{
    Quantity, Record,
    table::{Cell, Column, Row, Table, distinct, groups},
};

/// A paper's published figures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Published {
    /// Which paper and table.
    pub source: String,
    /// Its figures.
    pub rows: Vec<PublishedRow>,
    /// How its protocol differs from that of our runs, one line a difference.
    pub footnotes: Vec<String>,
}

/// A paper's figures for one variant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PublishedRow {
    /// The variant of ours that it belongs to, or a name of its own.
    pub variant: String,
    /// The scene, where the figures are those of one scene; else they are means over the paper's scenes.
    pub scene: Option<String>,
    /// Its figures.
    pub figures: Vec<(Quantity, Summary)>,
}

impl PublishedRow {
    fn summary(&self, quantity: Quantity) -> Option<Summary> {
        self.figures.iter().find(|(of, _)| *of == quantity).map(|(_, summary)| *summary)
    }
}

impl Published {
    /// The paper's mean over its scenes.
    pub(crate) fn value(&self, variant: &str, quantity: Quantity) -> Option<f64> {
        let row = self.rows.iter().find(|row| row.variant == variant && row.scene.is_none())?;
        row.summary(quantity).map(|summary| summary.mean)
    }

    /// Ours beside the paper's, a column each; none if the paper gives no figures.
    ///
    /// Rows are our variants and then what the paper has beside them; figures of single scenes only for scenes of ours.
    pub fn table(&self, records: &[Record]) -> Option<Table> {
        let scenes = distinct(records, |record| record.scene.clone());
        let measured = |quantity: Quantity| records.iter().any(|record| quantity.value(record).is_some());
        let shown = |quantity: &Quantity| self.rows.iter().any(|row| row.summary(*quantity).is_some());
        let quantities: Vec<Quantity> = Quantity::all().into_iter().filter(shown).collect();
        if quantities.is_empty() {
            return None;
        }
        let mut columns = Vec::new();
        for &quantity in &quantities {
            if measured(quantity) {
                columns.push((Column { heading: format!("{}, here", quantity.heading()), quantity }, true));
            }
            columns.push((Column { heading: format!("{}, paper", quantity.heading()), quantity }, false));
        }
        let groups = groups(records);
        let row = |label: String, variant: &str, scene: Option<&String>| {
            let ours = groups.iter().find(|group| group.label == variant);
            let paper = self.rows.iter().find(|row| row.variant == variant && row.scene.as_ref() == scene);
            let scenes = scene.map_or(&scenes[..], std::slice::from_ref);
            let cell = |(column, here): &(Column, bool)| match here {
                true => ours.map(|group| group.cell(column.quantity, scenes)).unwrap_or_default(),
                false => Cell { summary: paper.and_then(|row| row.summary(column.quantity)), ..Cell::default() },
            };
            Row { label, settings: Vec::new(), cells: columns.iter().map(cell).collect() }
        };
        let known = |variant: &str| groups.iter().any(|group| group.label == variant);
        let mut rows: Vec<Row> = groups.iter().map(|group| row(group.label.clone(), &group.label, None)).collect();
        for published in &self.rows {
            let variant = &published.variant;
            match &published.scene {
                None if !known(variant) => rows.push(row(variant.clone(), variant, None)),
                Some(scene) if known(variant) && scenes.contains(scene) => {
                    rows.push(row(format!("{variant}, {scene}"), variant, Some(scene)));
                }
                _ => {}
            }
        }
        let columns = columns.into_iter().map(|(column, _)| column).collect();
        let title = format!("Beside the paper: {}", self.source);
        Some(Table { title, protocol: Vec::new(), keys: Vec::new(), columns, rows, notes: self.footnotes.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::two_by_two;

    fn published() -> Published {
        let row = |variant: &str, scene: Option<&str>, psnr| PublishedRow {
            variant: variant.into(),
            scene: scene.map(str::to_owned),
            figures: Summary::of([psnr]).map(|psnr| (Quantity::PSNR, psnr)).into_iter().collect(),
        };
        Published {
            source: "Table 1".into(),
            rows: vec![row("nerf", None, 15.93), row("other", None, 16.0), row("nerf", Some("lego"), 15.61)],
            footnotes: vec!["images: 400 pixels here; 800 in the paper".into()],
        }
    }

    #[test]
    fn ours_and_theirs_stand_side_by_side() {
        let table = published().table(&two_by_two()).unwrap();
        let text: Vec<(String, Vec<String>)> = table
            .rows
            .iter()
            .map(|row| (row.label.clone(), row.cells.iter().enumerate().map(|(i, c)| table.text(c, i)).collect()))
            .collect();
        let expected = [
            ("nerf", ["17.00 ± 0.71", "15.93"]),
            ("infonerf", ["19.00 ± 0.71", "–"]),
            ("other", ["–", "16.00"]),
            ("nerf, lego", ["16.50 ± 0.71", "15.61"]),
        ];
        let expected = expected.map(|(label, cells)| (label.to_owned(), cells.map(str::to_owned).to_vec()));
        assert_eq!(text, expected);
        assert_eq!(table.footnotes(), ["images: 400 pixels here; 800 in the paper"]);
        assert!(table.to_markdown().contains("800 in the paper"));
    }

    #[test]
    fn a_paper_without_figures_has_no_table() {
        assert_eq!(Published::default().table(&two_by_two()), None);
        assert_eq!(published().value("nerf", Quantity::PSNR), Some(15.93));
        assert_eq!(published().value("nerf", Quantity::SSIM), None);
    }
}
