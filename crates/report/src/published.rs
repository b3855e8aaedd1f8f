//! A paper's published figures, shown next to ours.

use infonerf_metrics::Summary;

use crate::quantity::Quantity;
use crate::record::{Record, distinct};
use crate::table::{Cell, Column, Table, TableRow, VariantGroup, groups, measured};

/// Published figures of a paper.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Published {
    /// Name of the paper and its table.
    pub source: String,
    /// Figures of each variant.
    pub rows: Vec<PublishedRow>,
    /// Differences of the paper's protocol from that of our runs, one line each.
    pub footnotes: Vec<String>,
}

/// Figures of a paper for one variant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PublishedRow {
    /// Name of our variant that the figures belong to, or another name.
    pub variant: String,
    /// Scene of the figures; `None` for means over the paper's scenes.
    pub scene: Option<String>,
    /// Value of each quantity.
    pub figures: Vec<(Quantity, Summary)>,
}

impl PublishedRow {
    fn summary(&self, quantity: Quantity) -> Option<Summary> {
        self.figures.iter().find(|(of, _)| *of == quantity).map(|(_, summary)| *summary)
    }
}

impl Published {
    pub(crate) fn value(&self, variant: &str, quantity: Quantity) -> Option<f64> {
        let row = self.rows.iter().find(|row| row.variant == variant && row.scene.is_none())?;
        row.summary(quantity).map(|summary| summary.mean)
    }

    /// Makes a table of our figures next to the paper's, a column each; `None` if the paper has no figures.
    ///
    /// Rows are our variants, then the paper's other variants and, for our scenes only, its figures of single scenes.
    pub fn table<R: AsRef<Record>>(&self, records: &[R]) -> Option<Table> {
        let scenes = distinct(records, |record| record.scene.clone());
        let shown = |quantity: &Quantity| self.rows.iter().any(|row| row.summary(*quantity).is_some());
        let quantities: Vec<Quantity> = Quantity::all().into_iter().filter(shown).collect();
        if quantities.is_empty() {
            return None;
        }
        let mut columns = Vec::new();
        for &quantity in &quantities {
            if measured(records, quantity) {
                columns.push((Column { heading: format!("{}, here", quantity.heading()), quantity }, true));
            }
            columns.push((Column { heading: format!("{}, paper", quantity.heading()), quantity }, false));
        }
        let groups = groups(records.iter().map(AsRef::as_ref));
        let row = |label: String, ours: Option<&VariantGroup>, variant: &str, scene: Option<&String>| {
            let paper = self.rows.iter().find(|row| row.variant == variant && row.scene.as_ref() == scene);
            let scenes = scene.map_or(&scenes[..], std::slice::from_ref);
            let cell = |(column, here): &(Column, bool)| match here {
                true => ours.map(|group| group.cell(column.quantity, scenes)).unwrap_or_default(),
                false => Cell { summary: paper.and_then(|row| row.summary(column.quantity)), ..Cell::default() },
            };
            TableRow { label, settings: Vec::new(), cells: columns.iter().map(cell).collect() }
        };
        let mut rows: Vec<TableRow> =
            groups.iter().map(|group| row(group.label.clone(), Some(group), group.variant(), None)).collect();
        for PublishedRow { variant, scene, .. } in &self.rows {
            let ours: Vec<&VariantGroup> = groups.iter().filter(|group| group.variant() == variant).collect();
            match scene {
                None if ours.is_empty() => rows.push(row(variant.clone(), None, variant, None)),
                Some(scene) if scenes.contains(scene) => {
                    let of_scene = |group: &VariantGroup| {
                        row(format!("{}, {scene}", group.label), Some(group), variant, Some(scene))
                    };
                    rows.extend(ours.into_iter().map(of_scene));
                }
                _ => {}
            }
        }
        let columns = columns.into_iter().map(|(column, _)| column).collect();
        let title = format!("Next to the paper: {}", self.source);
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
    fn our_figures_stand_next_to_the_papers() {
        let table = published().table(&two_by_two()).unwrap();
        let expected = "\
**Next to the paper: Table 1**

| variant | PSNR (dB) ↑, here | PSNR (dB) ↑, paper |
| --- | ---: | ---: |
| nerf | 17.00 ± 0.71 | 15.93 |
| infonerf | 19.00 ± 0.71 | – |
| other | – | 16.00 |
| nerf, lego | 16.50 ± 0.71 | 15.61 |

images: 400 pixels here; 800 in the paper
";
        assert_eq!(table.to_markdown(), expected);
    }

    /// Two presets of a variant, `nerf (fast)` and `nerf (released)`, each have the paper's figures of `nerf`.
    #[test]
    fn rows_are_joined_by_variant_whatever_the_preset() {
        let mut records = two_by_two();
        let released = records.iter().map(|record| Record { preset: "released".into(), ..record.clone() });
        records.extend(released.collect::<Vec<_>>());
        let markdown = published().table(&records).unwrap().to_markdown();
        for preset in ["fast", "released"] {
            assert!(markdown.contains(&format!("\n| nerf ({preset}) | 17.00 ± 0.71 | 15.93 |\n")), "{markdown}");
            assert!(markdown.contains(&format!("\n| nerf ({preset}), lego | 16.50 ± 0.71 | 15.61 |\n")), "{markdown}");
        }
        assert!(!markdown.contains("| nerf |"), "{markdown}");
    }

    #[test]
    fn a_paper_without_figures_has_no_table() {
        assert_eq!(Published::default().table(&two_by_two()), None);
        assert_eq!(published().value("nerf", Quantity::PSNR), Some(15.93));
        assert_eq!(published().value("nerf", Quantity::SSIM), None);
    }
}
