//! Quality over the values of a sweep: a line for one grid, a heat map for two, and whether the best setting leads.

use std::collections::HashMap;

use anyhow::Result;
use indexmap::IndexSet;
use infonerf_report::chart::{Axis, Bar, ChartFrame, Series, bar_chart, heat_map, line_chart};
use infonerf_report::{Claim, Comparison, Figure, Quantity, Record, Relation, Side, overview_table};

use super::grid::Grid;
use super::{Sweep, assignments};

/// Values that span more than this are shown on a logarithmic axis.
const WIDE: f64 = 30.0;

/// Mean PSNR over scenes and seeds, by the name of a variant with its values.
pub(crate) type Means = HashMap<String, f64>;

/// Returns the mean PSNR of each setting (a variant with its values) that has one.
pub(crate) fn means(records: &[Record]) -> Means {
    let table = overview_table(records, &[Quantity::PSNR]);
    let mean = |row: &infonerf_report::TableRow| Some((row.label.clone(), row.cells.first()?.summary?.mean));
    table.rows.iter().filter_map(mean).collect()
}

/// Charts of PSNR over the values; none for three grids or more, which are read from the table.
pub(super) fn figures(sweep: &Sweep, records: &[Record]) -> Result<Vec<Figure>> {
    let means = means(records);
    match &sweep.grids[..] {
        [grid] if (0..grid.values.len()).all(|i| grid.number(i).is_some()) => Ok(vec![line(sweep, grid, &means)?]),
        [grid] => variants(sweep).iter().map(|variant| bars(sweep, grid, variant, &means)).collect(),
        [rows, columns] => variants(sweep).iter().map(|variant| map(sweep, rows, columns, variant, &means)).collect(),
        _ => Ok(Vec::new()),
    }
}

/// Returns the experiment's variants, in the order of the sweep.
fn variants(sweep: &Sweep) -> Vec<String> {
    let variants: IndexSet<&String> = sweep.items.iter().map(|item| &item.variant).collect();
    variants.into_iter().cloned().collect()
}

/// Means of `variant`, by choice of values.
fn by_choice<'a>(sweep: &'a Sweep, means: &Means, variant: &str) -> HashMap<&'a [usize], f64> {
    let own = sweep.items.iter().filter(|item| item.variant == variant);
    own.filter_map(|item| Some((&item.choice[..], *means.get(&item.plan.variant)?))).collect()
}

fn line(sweep: &Sweep, grid: &Grid, means: &Means) -> Result<Figure> {
    let values: Vec<f64> = (0..grid.values.len()).filter_map(|i| grid.number(i)).collect();
    let positive = || values.iter().copied().filter(|value| *value > 0.0);
    let least = positive().fold(f64::INFINITY, f64::min);
    let log = values.iter().all(|value| *value >= 0.0) && positive().fold(0.0, f64::max) > WIDE * least;
    // Zero has no place on a logarithmic axis and is shown a decade before the least.
    let place = |value: f64| if log && value == 0.0 { 0.1 * least } else { value };
    let series = variants(sweep).into_iter().map(|name| {
        let means = by_choice(sweep, means, &name);
        let point = |(i, value): (usize, &f64)| Some((place(*value), *means.get(&[i][..])?));
        let mut points: Vec<(f64, f64)> = values.iter().enumerate().filter_map(point).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Series { name, points }
    });
    let title = format!("{} by {}", Quantity::PSNR.heading(), grid.key());
    let key = grid.key();
    let axis = if log { Axis::log(&key) } else { Axis::linear(&key) };
    let frame = ChartFrame { title: title.clone(), x: axis, y: Axis::linear("PSNR (dB)") };
    let svg = line_chart(&frame, &series.collect::<Vec<_>>())?;
    let caption = if log && values.contains(&0.0) { "The leftmost point is 0." } else { "" };
    Ok(Figure { name: "sweep-psnr".into(), title, svg, caption: caption.into() })
}

fn bars(sweep: &Sweep, grid: &Grid, variant: &str, means: &Means) -> Result<Figure> {
    let means = by_choice(sweep, means, variant);
    let bar =
        |(i, label): (usize, &String)| Some(Bar { label: label.clone(), value: *means.get(&[i][..])?, spread: None });
    let bars: Vec<Bar> = grid.values.iter().enumerate().filter_map(bar).collect();
    let title = format!("{variant}: {} by {}", Quantity::PSNR.heading(), grid.key());
    let svg = bar_chart(&ChartFrame::new(&title, &grid.key(), "PSNR (dB)"), &bars)?;
    Ok(Figure { name: format!("sweep-psnr-{variant}"), title, svg, caption: String::new() })
}

fn map(sweep: &Sweep, rows: &Grid, columns: &Grid, variant: &str, means: &Means) -> Result<Figure> {
    let means = by_choice(sweep, means, variant);
    let cell = |row, column| means.get(&[row, column][..]).copied();
    let line = |row| (0..columns.values.len()).map(|column| cell(row, column)).collect();
    let values: Vec<Vec<Option<f64>>> = (0..rows.values.len()).map(line).collect();
    let title = format!("{variant}: {}", Quantity::PSNR.heading());
    let svg = heat_map(&ChartFrame::new(&title, &columns.key(), &rows.key()), &columns.values, &rows.values, &values)?;
    Ok(Figure { name: format!("sweep-psnr-{variant}"), title, svg, caption: "Mean over scenes and seeds.".into() })
}

/// Returns a claim for each variant: the setting with the highest mean PSNR is better than each of its neighbours,
/// whose value of one key is the next lower or higher one. Like every [`Claim`] it is tested on differences within a
/// scene and seed. The setting was chosen on the very runs that test it, so its lead is overestimated, and the
/// statement says so.
///
/// Nothing if values have no order: grids of other things than numbers.
pub(super) fn claims(sweep: &Sweep, records: &[Record]) -> Vec<Claim> {
    let ranks = sweep.grids.iter().map(ranks).collect::<Option<Vec<_>>>().filter(|ranks| !ranks.is_empty());
    let Some(ranks) = ranks else { return Vec::new() };
    let means = means(records);
    variants(sweep)
        .iter()
        .filter_map(|variant| claim(sweep, variant, &ranks, &by_choice(sweep, &means, variant)))
        .collect()
}

/// Returns the rank of each value, which is how many are smaller; `None` unless all are numbers.
fn ranks(grid: &Grid) -> Option<Vec<usize>> {
    let numbers = (0..grid.values.len()).map(|index| grid.number(index)).collect::<Option<Vec<f64>>>()?;
    Some(numbers.iter().map(|number| numbers.iter().filter(|other| *other < number).count()).collect())
}

/// Compares the setting with the highest of `means` with its neighbours.
fn claim(sweep: &Sweep, variant: &str, ranks: &[Vec<usize>], means: &HashMap<&[usize], f64>) -> Option<Claim> {
    let (best, _) = means.iter().max_by(|a, b| a.1.total_cmp(b.1).then_with(|| b.0.cmp(a.0)))?;
    let steps = |choice: &[usize]| -> usize {
        ranks.iter().zip(best.iter().zip(choice)).map(|(ranks, (&a, &b))| ranks[a].abs_diff(ranks[b])).sum()
    };
    let mut neighbours: Vec<&[usize]> = means.keys().copied().filter(|choice| steps(choice) == 1).collect();
    neighbours.sort_unstable();
    let side = |choice: &[usize]| {
        let item = sweep.items.iter().find(|item| item.variant == variant && item.choice == choice)?;
        Some(Side::Variant(item.plan.variant.clone()))
    };
    let comparison =
        |other: &&[usize]| Some(Comparison { left: side(best)?, is: Relation::Better, right: side(other)? });
    let comparisons: Vec<Comparison> = neighbours.iter().filter_map(comparison).collect();
    let statement = format!(
        "{variant}: the best setting, {}, is better than its neighbours (chosen on these very runs, which flatters it)",
        assignments(&sweep.grids, best).join(" ")
    );
    let claim = Claim { statement, metric: Quantity::PSNR, margin: 0.0, comparisons };
    (!claim.comparisons.is_empty()).then_some(claim)
}

#[cfg(test)]
mod tests {
    use infonerf_report::Verdict;

    use super::super::Item;
    use super::*;
    use crate::Selection;

    #[test]
    fn the_best_is_compared_with_its_neighbours() {
        let selection = Selection {
            scenes: vec!["knot".into(), "crane".into(), "castle".into()],
            variants: vec!["infonerf".into()],
            ..Selection::default()
        };
        let grids = ["loss.entropy.weight=1e-3,0,1e-2,1e-4", "loss.kl.weight=0,1e-5"].map(str::to_owned).to_vec();
        let sweep = Sweep::plan("fast-losses", &grids, &selection).unwrap();
        let psnr = |scene: &str, choice: &[usize]| {
            // The second best is better than the best on one scene.
            let noise = if choice[0] == 2 && scene == "knot" { 0.2 } else { 0.0 };
            [20.0, 14.0, 19.9, 16.0][choice[0]] - 0.5 * choice[1] as f64 + noise
        };
        let record = |item: &Item| Record {
            scene: item.plan.scene.clone(),
            variant: item.plan.variant.clone(),
            metrics: [("psnr".to_owned(), Some(psnr(&item.plan.scene, &item.choice)))].into_iter().collect(),
            ..Record::default()
        };
        let records: Vec<Record> = sweep.items.iter().map(record).collect();
        let claims = claims(&sweep, &records);
        assert_eq!(claims.len(), 1);
        assert!(claims[0].statement.contains("loss.entropy.weight=1e-3 loss.kl.weight=0,"), "{}", claims[0].statement);
        // λ₁ one lower and one higher, in whatever order they were written, and λ₂ one higher.
        assert_eq!(claims[0].comparisons.len(), 3);
        let tested = claims[0].test(&records, None);
        let count = |verdict| tested.findings.iter().filter(|finding| finding.verdict == verdict).count();
        assert_eq!((count(Verdict::Holds), count(Verdict::Undecided)), (2, 1), "{tested:?}");
    }
}
