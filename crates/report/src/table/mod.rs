//! Comparison tables: rows are variants, columns scenes or quantities, cells mean ± standard deviation over seeds.

mod format;

use std::collections::BTreeSet;

use indexmap::{IndexMap, IndexSet};
use infonerf_metrics::Summary;

use crate::interval::Interval;
use crate::protocol::protocol_lines;
use crate::quantity::Quantity;
use crate::record::{Record, Setting, distinct, short_key};

const MEAN: &str = "mean";
const MISSING: &str = "–";
/// Mark of a cell in which a run collapsed.
const COLLAPSED: &str = "†";
const COLLAPSED_NOTE: &str = "† a run of this cell collapsed: its field went empty";

/// Table of results with the protocol that its numbers follow.
///
/// Every format has the protocol above the table: [`Table::to_markdown`], [`Table::to_latex`], [`Table::to_csv`] and
/// [`Table::to_text`].
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Heading of the table.
    pub title: String,
    /// Protocol of the numbers, from [`protocol_lines`].
    pub protocol: Vec<String>,
    /// Keys that a sweep set, each with a column after that of the variants.
    pub keys: Vec<String>,
    /// Columns of numbers.
    pub columns: Vec<Column>,
    /// A row for each variant, in the order of the records.
    pub rows: Vec<TableRow>,
    /// Remarks below the table, in addition to those that the cells need.
    pub notes: Vec<String>,
}

/// Column of a [`Table`].
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Heading: a scene or a quantity.
    pub heading: String,
    /// Quantity of the cells, which determines their decimals and which values are better.
    pub quantity: Quantity,
}

/// Row of a [`Table`].
#[derive(Debug, Clone, PartialEq)]
pub struct TableRow {
    /// Variant, with its preset if the records have several.
    pub label: String,
    /// Value of each of the table's keys.
    pub settings: Vec<String>,
    /// Cell of each of the table's columns.
    pub cells: Vec<Cell>,
}

/// Cell of a [`Table`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cell {
    /// Mean and spread over seeds; `None` if nothing was measured.
    pub summary: Option<Summary>,
    /// Whether the cell is the best of its column, to the decimals shown, among cells in which nothing collapsed. Never set
    /// in a column whose values are all the same, or single.
    pub best: bool,
    /// Whether the cell is the best, and its 95 % interval over seeds overlaps that of no other cell.
    pub clear: bool,
    /// Whether a run of the cell collapsed.
    pub collapsed: bool,
}

/// Makes a table of variants against scenes for one quantity; its last column is the mean over several scenes.
///
/// A mean over scenes is taken for each seed first, over the seeds that ran on every scene, and summarised over those
/// seeds: its spread is that of the number that a paper prints. A variant which lacks a scene has no mean.
pub fn scene_table<R: AsRef<Record>>(records: &[R], quantity: Quantity) -> Table {
    let scenes = distinct(records, |record| record.scene.clone());
    let column = |heading: &str| Column { heading: heading.to_owned(), quantity };
    let each = scenes.iter().map(|scene| (column(scene), std::slice::from_ref(scene)));
    let mean = (scenes.len() > 1).then(|| (column(MEAN), &scenes[..]));
    assemble(quantity.heading(), records, each.chain(mean).collect())
}

/// Makes a table of variants against the quantities that have values, means over all scenes as in [`scene_table`].
pub fn overview_table<R: AsRef<Record>>(records: &[R], quantities: &[Quantity]) -> Table {
    let scenes = distinct(records, |record| record.scene.clone());
    let quantities = quantities.iter().filter(|quantity| measured(records, **quantity));
    let column = |&quantity: &Quantity| (Column { heading: quantity.heading(), quantity }, &scenes[..]);
    let title = match scenes.as_slice() {
        [scene] => scene.clone(),
        scenes => format!("mean over {} scenes", scenes.len()),
    };
    assemble(title, records, quantities.map(column).collect())
}

pub(crate) struct VariantGroup<'a> {
    /// Label: variant, values and, if there are several presets, the preset.
    pub(crate) label: String,
    /// End of the label with the preset; empty if there is only one preset.
    suffix: String,
    /// Records by scene and seed; the first one if several have the same.
    records: IndexMap<(&'a str, u64), &'a Record>,
}

/// Groups records by variant and preset, in order of appearance; the preset is part of the label if there are several.
pub(crate) fn groups<'a>(records: impl Iterator<Item = &'a Record> + Clone) -> Vec<VariantGroup<'a>> {
    let presets = records.clone().map(|record| &record.preset).collect::<IndexSet<_>>().len();
    let mut groups: IndexMap<(&str, &str), VariantGroup> = IndexMap::new();
    for record in records {
        let key = (record.variant.as_str(), record.preset.as_str());
        let group = groups.entry(key).or_insert_with(|| {
            let suffix = if presets > 1 { format!(" ({})", record.preset) } else { String::new() };
            VariantGroup { label: record.label() + &suffix, suffix, records: IndexMap::new() }
        });
        group.records.entry((&record.scene, record.seed)).or_insert(record);
    }
    groups.into_values().collect()
}

impl<'a> VariantGroup<'a> {
    /// Returns the name of the variant without its preset.
    pub(crate) fn variant(&self) -> &'a str {
        &self.records[0].variant
    }

    fn setting(&self) -> Option<&'a Setting> {
        self.records[0].setting.as_ref()
    }

    /// Returns the record of `scene` with the lowest seed.
    pub(crate) fn first(&self, scene: &str) -> Option<&'a Record> {
        let own = self.records.values().filter(|record| record.scene == scene);
        own.min_by_key(|record| record.seed).copied()
    }

    pub(crate) fn mean(&self, quantity: Quantity, scenes: &[String]) -> Option<f64> {
        self.cell(quantity, scenes).summary.map(|summary| summary.mean)
    }

    /// Computes the mean over `scenes` for each seed that ran on all of them, and summarises these means over seeds.
    pub(crate) fn cell(&self, quantity: Quantity, scenes: &[String]) -> Cell {
        let seeds: BTreeSet<u64> = self.records.keys().map(|(_, seed)| *seed).collect();
        let mean = |seed: u64| {
            let value = |scene: &String| quantity.value(self.records.get(&(scene.as_str(), seed))?);
            let values: Option<Vec<f64>> = scenes.iter().map(value).collect();
            Summary::of(values?).map(|summary| summary.mean)
        };
        let collapsed = self.records.values().any(|record| record.collapsed && scenes.contains(&record.scene));
        Cell { summary: Summary::of(seeds.into_iter().filter_map(mean)), collapsed, ..Cell::default() }
    }
}

pub(crate) fn measured<R: AsRef<Record>>(records: &[R], quantity: Quantity) -> bool {
    records.iter().any(|record| quantity.value(record.as_ref()).is_some())
}

/// Makes a table of columns, each with the scenes over which its cells are means.
fn assemble<R: AsRef<Record>>(title: String, records: &[R], columns: Vec<(Column, &[String])>) -> Table {
    let groups = groups(records.iter().map(AsRef::as_ref));
    let settings = groups.iter().filter_map(VariantGroup::setting);
    let keys: IndexSet<&String> = settings.flat_map(|setting| setting.values.keys()).collect();
    let value = |group: &VariantGroup, key: &String| {
        group.setting().and_then(|setting| setting.values.get(key)).map_or(MISSING, String::as_str).to_owned()
    };
    let row = |group: &VariantGroup| TableRow {
        label: group.setting().map_or(group.variant(), |setting| &setting.variant).to_owned() + &group.suffix,
        settings: keys.iter().map(|key| value(group, key)).collect(),
        cells: columns.iter().map(|(column, scenes)| group.cell(column.quantity, scenes)).collect(),
    };
    let rows = groups.iter().map(row).collect();
    let symbols = keys.iter().map(|key| (short_key(key), key)).filter(|(short, key)| *short != key.as_str());
    let symbols: Vec<String> = symbols.map(|(short, key)| format!("{short} is {key}")).collect();
    let notes = if symbols.is_empty() { Vec::new() } else { vec![symbols.join(", ")] };
    let keys = keys.into_iter().cloned().collect();
    let columns = columns.into_iter().map(|(column, _)| column).collect();
    let mut table = Table { title, protocol: protocol_lines(records), keys, columns, rows, notes };
    mark_best(&mut table);
    table
}

/// Marks the best cells of each column, and among them those whose interval overlaps no other.
fn mark_best(Table { columns, rows, .. }: &mut Table) {
    for (index, column) in columns.iter().enumerate() {
        let mut cells: Vec<&mut Cell> = rows.iter_mut().filter_map(|row| row.cells.get_mut(index)).collect();
        let rank = |cell: &Cell| Some(column.quantity.rank(cell.summary?.mean));
        let ranks: Vec<Option<f64>> = cells.iter().map(|cell| rank(cell).filter(|_| !cell.collapsed)).collect();
        let best = ranks.iter().flatten().copied().min_by(f64::total_cmp);
        let shown: Vec<f64> = cells.iter().filter_map(|cell| rank(cell)).collect();
        if shown.windows(2).all(|pair| pair[0] == pair[1]) {
            continue;
        }
        // 95 % intervals of means over seeds; none for a single seed.
        let interval = |(row, cell): (usize, &&mut Cell)| Some((row, Interval::of_summary(&cell.summary?).bounds));
        let intervals: IndexMap<usize, Option<[f64; 2]>> = cells.iter().enumerate().filter_map(interval).collect();
        for (row, cell) in cells.iter_mut().enumerate().filter(|(row, _)| ranks[*row].is_some() && ranks[*row] == best)
        {
            let apart = |[low, high]: [f64; 2]| {
                let mut others = intervals.iter().filter(|(other, _)| **other != row);
                others.all(|(_, bounds)| bounds.is_some_and(|other| other[1] < low || high < other[0]))
            };
            cell.best = true;
            cell.clear = intervals[&row].is_some_and(apart);
        }
    }
}

impl Column {
    /// Returns the column's place by importance: the mean over scenes first, then the metrics that papers print.
    fn rank(&self) -> usize {
        const FIRST: [&str; 4] = ["psnr", "ssim", "lpips_vgg", "train_seconds"];
        let place = FIRST.iter().position(|key| *key == self.quantity.key).unwrap_or(FIRST.len());
        if self.heading == MEAN { 0 } else { 1 + place }
    }
}

impl TableRow {
    /// Returns the texts before the numbers: the label and the settings.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.label).chain(&self.settings).map(String::as_str)
    }
}

impl Table {
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once("variant").chain(self.keys.iter().map(|key| short_key(key)))
    }

    /// Formats a cell without emphasis: `18.65 ± 0.12`, `18.65`, `18.65†` or `–`.
    pub(crate) fn text(&self, cell: &Cell, column: usize) -> String {
        let decimals = self.columns.get(column).map_or(2, |column| column.quantity.decimals);
        let value = cell.summary.map_or(MISSING.to_owned(), |summary| format!("{summary:.decimals$}"));
        if cell.collapsed { value + COLLAPSED } else { value }
    }

    pub(crate) fn cells<'a>(&'a self, row: &'a TableRow) -> impl Iterator<Item = (&'a Cell, String)> {
        row.cells.iter().enumerate().map(|(column, cell)| (cell, self.text(cell, column)))
    }

    pub(crate) fn has_clear(&self) -> bool {
        self.rows.iter().flat_map(|row| &row.cells).any(|cell| cell.clear)
    }

    pub(crate) fn footnotes(&self) -> Vec<&str> {
        let collapsed = self.rows.iter().flat_map(|row| &row.cells).any(|cell| cell.collapsed);
        collapsed.then_some(COLLAPSED_NOTE).into_iter().chain(self.notes.iter().map(String::as_str)).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::record::TestViews;

    pub(crate) fn record(scene: &str, variant: &str, seed: u64, psnr: f64) -> Record {
        Record {
            experiment: "synthetic-4view".into(),
            scene: scene.into(),
            variant: variant.into(),
            seed,
            preset: "fast".into(),
            device: "flex".into(),
            train_views: vec![26, 86, 2, 55],
            test_views: TestViews { protocol: "every-8".into(), count: 25, ids: (0..200).step_by(8).collect() },
            image_size: [400, 400],
            iterations: 1000,
            train_seconds: 60.0,
            samples_total: 1000,
            samples_evaluated: 100,
            metrics: [("psnr".to_owned(), Some(psnr))].into_iter().collect(),
            ..Record::default()
        }
    }

    pub(crate) fn two_by_two() -> Vec<Record> {
        let mut records = Vec::new();
        for (variant, offset) in [("nerf", 0.0), ("infonerf", 2.0)] {
            for (scene, psnr) in [("lego", 16.0), ("mic", 17.0)] {
                for seed in 0..2 {
                    records.push(record(scene, variant, seed, psnr + offset + seed as f64));
                }
            }
        }
        records
    }

    #[test]
    fn best_is_clear_where_intervals_are_disjoint() {
        for (gain, seeds, clear) in [(3.0, 5, true), (0.5, 5, false), (3.0, 1, false)] {
            let run = |variant, seed: u64, psnr| record("lego", variant, seed, psnr + (seed % 2) as f64);
            let pair = |seed| [run("nerf", seed, 15.0), run("infonerf", seed, 15.0 + gain)];
            let records: Vec<Record> = (0..seeds).flat_map(pair).collect();
            let cell = scene_table(&records, Quantity::PSNR).rows[1].cells[0];
            assert!(cell.best && cell.clear == clear, "{gain} over {seeds} seeds: {cell:?}");
        }
    }

    #[test]
    fn a_missing_scene_leaves_no_mean() {
        let mut records = two_by_two();
        records.retain(|record| !(record.scene == "mic" && record.variant == "nerf"));
        let table = scene_table(&records, Quantity::PSNR);
        assert_eq!(table.rows[0].cells[2].summary, None);
        assert!(!table.rows[1].cells[2].best);
    }

    #[test]
    fn collapsed_cells_are_never_best_and_ties_share() {
        let runs = [("a", 10.0), ("b", 20.0), ("c", 10.001)];
        let mut records = runs.map(|(variant, psnr)| record("lego", variant, 0, psnr)).to_vec();
        records[1].collapsed = true;
        let table = scene_table(&records, Quantity::PSNR);
        let best: Vec<bool> = table.rows.iter().map(|row| row.cells[0].best).collect();
        assert_eq!(best, [true, false, true]);
        records[2].metrics = records[0].metrics.clone();
        records.remove(1);
        let same = scene_table(&records, Quantity::PSNR);
        assert!(!same.rows.iter().any(|row| row.cells[0].best));
        assert_eq!(table.text(&table.rows[1].cells[0], 0), "20.00†");
        assert_eq!(table.footnotes().len(), 1);
    }

    #[test]
    fn settings_of_a_sweep_are_columns_under_the_papers_symbols() {
        let run = |variant: &str, weight: &str, psnr| {
            let values = [("loss.entropy.weight", weight), ("train.rays", "64")];
            let values = values.map(|(key, value)| (key.to_owned(), value.to_owned())).into_iter().collect();
            let setting = Some(Setting { variant: "infonerf".into(), values });
            Record { setting, ..record("lego", variant, 0, psnr) }
        };
        let records = [run("a", "1e-3", 18.0), run("b", "1e-2", 19.0)];
        let table = overview_table(&records, &[Quantity::PSNR]);
        let markdown = table.to_markdown();
        let row = "| infonerf | 1e-2 | 64 | **19.00** |";
        for part in ["| variant | λ₁ | rays | PSNR", row, "λ₁ is loss.entropy.weight"] {
            assert!(markdown.contains(part), "{part}: {markdown}");
        }
        assert!(table.to_csv().contains("\ninfonerf,1e-3,64,18,,1\n"));
        assert!(table.to_text().contains("\ninfonerf  1e-3    64 "));
        assert_eq!(records[0].label(), "infonerf, λ₁ = 1e-3, rays = 64");
    }

    #[test]
    fn overview_leaves_out_unmeasured_quantities() {
        let [lpips, skipped] = ["lpips_alex", "samples_skipped"].map(|key| Quantity::named(key).unwrap());
        let table = overview_table(&two_by_two(), &[Quantity::PSNR, lpips, skipped]);
        let quantities: Vec<Quantity> = table.columns.iter().map(|column| column.quantity).collect();
        assert_eq!(quantities, [Quantity::PSNR, skipped]);
        assert_eq!(overview_table::<Record>(&[], &Quantity::all()).rows, []);
    }
}
