//! Charts of PSNR over the values of a sweep (lines for one grid, a heat map for two), and over the variants of an experiment.

use std::collections::{BTreeMap, HashMap};

use anyhow::Result;
use indexmap::IndexSet;
use infonerf_report::chart::{Bar, ChartFrame, Series, bar_chart, heat_map, line_chart};
use infonerf_report::{Figure, Quantity, Record, ReportError, overview_table};
use serde::Deserialize;

use super::Sweep;
use super::grid::Grid;

/// Ratio of the max to the min value above which an axis is logarithmic.
const WIDE: f64 = 30.0;

/// Mean PSNR over scenes and seeds, by the name of a variant with its values.
type Means = HashMap<String, f64>;

/// Returns the mean PSNR of each setting (a variant with its values) that has one.
fn means(records: &[Record]) -> Means {
    let table = overview_table(records, &[Quantity::PSNR]);
    let mean = |row: &infonerf_report::TableRow| Some((row.label.clone(), row.cells.first()?.summary?.mean));
    table.rows.iter().filter_map(mean).collect()
}

/// Draws PSNR over the values of a sweep. Three grids or more have no chart, only the table.
pub(super) fn figures(sweep: &Sweep, records: &[Record]) -> Result<Vec<Figure>> {
    let means = means(records);
    match &sweep.grids[..] {
        [grid] if (0..grid.values.len()).all(|i| grid.number(i).is_some()) => Ok(vec![line(sweep, grid, &means)?]),
        [grid] => variants(sweep).iter().map(|variant| bars(sweep, grid, variant, &means)).collect(),
        [rows, columns] => variants(sweep).iter().map(|variant| map(sweep, rows, columns, variant, &means)).collect(),
        _ => Ok(Vec::new()),
    }
}

fn variants(sweep: &Sweep) -> IndexSet<String> {
    sweep.items.iter().map(|item| item.variant.clone()).collect()
}

/// Returns the means of `variant` by the indices of its values (`Item::choice`).
fn by_choice<'a>(sweep: &'a Sweep, means: &Means, variant: &str) -> HashMap<&'a [usize], f64> {
    let own = sweep.items.iter().filter(|item| item.variant == variant);
    own.filter_map(|item| Some((&item.choice[..], *means.get(&item.plan.variant)?))).collect()
}

fn line(sweep: &Sweep, grid: &Grid, means: &Means) -> Result<Figure> {
    let values: Vec<f64> = (0..grid.values.len()).filter_map(|i| grid.number(i)).collect();
    let positive = || values.iter().copied().filter(|value| *value > 0.0);
    let least = positive().fold(f64::INFINITY, f64::min);
    let log = values.iter().all(|value| *value >= 0.0) && positive().fold(0.0, f64::max) > WIDE * least;
    // A logarithmic axis has no place for zero, which is drawn one decade below the min positive value.
    let place = |value: f64| if log && value == 0.0 { 0.1 * least } else { value };
    let series = variants(sweep).into_iter().map(|name| {
        let means = by_choice(sweep, means, &name);
        let point = |(i, value): (usize, &f64)| Some((place(*value), *means.get(&[i][..])?));
        Series { name, points: values.iter().enumerate().filter_map(point).collect() }
    });
    let caption = if log && values.contains(&0.0) { "The leftmost point is 0." } else { "" };
    Ok(psnr_lines("sweep-psnr", &grid.key(), log, series, caption)?)
}

/// Draws PSNR by `x`, on a logarithmic axis if `log`, as a line through the points of each series from left to right.
fn psnr_lines(
    name: &str,
    x: &str,
    log: bool,
    series: impl Iterator<Item = Series>,
    caption: &str,
) -> Result<Figure, ReportError> {
    let mut series: Vec<Series> = series.collect();
    series.iter_mut().for_each(|series| series.points.sort_by(|a, b| a.0.total_cmp(&b.0)));
    let title = format!("{} by {x}", Quantity::PSNR.heading());
    let frame = ChartFrame { log_x: log, ..ChartFrame::new(&title, x, "PSNR (dB)") };
    let svg = line_chart(&frame, &series)?;
    Ok(Figure::new(name, frame, svg, caption))
}

fn bars(sweep: &Sweep, grid: &Grid, variant: &str, means: &Means) -> Result<Figure> {
    let means = by_choice(sweep, means, variant);
    let bar =
        |(i, label): (usize, &String)| Some(Bar { label: label.clone(), value: *means.get(&[i][..])?, spread: None });
    let bars: Vec<Bar> = grid.values.iter().enumerate().filter_map(bar).collect();
    let title = format!("{variant}: {} by {}", Quantity::PSNR.heading(), grid.key());
    let frame = ChartFrame::new(&title, &grid.key(), "PSNR (dB)");
    let svg = bar_chart(&frame, &bars)?;
    Ok(Figure::new(format!("sweep-psnr-{variant}"), frame, svg, ""))
}

fn map(sweep: &Sweep, rows: &Grid, columns: &Grid, variant: &str, means: &Means) -> Result<Figure> {
    let means = by_choice(sweep, means, variant);
    let cell = |row, column| means.get(&[row, column][..]).copied();
    let line = |row| (0..columns.values.len()).map(|column| cell(row, column)).collect();
    let values: Vec<Vec<Option<f64>>> = (0..rows.values.len()).map(line).collect();
    let frame = ChartFrame::new(&format!("{variant}: {}", Quantity::PSNR.heading()), &columns.key(), &rows.key());
    let svg = heat_map(&frame, &columns.values, &rows.values, &values)?;
    Ok(Figure::new(format!("sweep-psnr-{variant}"), frame, svg, "Mean over scenes and seeds."))
}

/// The `[plot]` of an experiment file: lines of the mean PSNR of variants over a number that each variant stands for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Plot {
    /// Label of the x-axis.
    x: String,
    /// Whether the x-axis is logarithmic.
    #[serde(default)]
    log: bool,
    /// Lines by name. Each line maps variants to their x-values.
    series: BTreeMap<String, BTreeMap<String, f64>>,
}

impl Plot {
    /// Returns the chart of `records`: means over scenes and seeds, as in the tables.
    pub(crate) fn figure(&self, records: &[Record]) -> Result<Figure, ReportError> {
        let means = means(records);
        let series = self.series.iter().map(|(name, variants)| {
            let point = |(variant, x): (&String, &f64)| Some((*x, *means.get(variant)?));
            Series { name: name.clone(), points: variants.iter().filter_map(point).collect() }
        });
        psnr_lines("psnr-by", &self.x, self.log, series, "Means over scenes and seeds.")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with_psnr;

    #[test]
    fn variants_become_points() {
        let text = "x = 'views'\nlog = true\n[series]\nNeRF = { nerf-2 = 2, nerf-4 = 4, nerf-100 = 100 }";
        let plot: Plot = toml::from_str(text).unwrap();
        let record = |variant: &str, psnr| with_psnr(psnr, Record { variant: variant.into(), ..Record::default() });
        let figure = plot.figure(&[record("nerf-4", 15.0), record("nerf-2", 12.0)]).unwrap();
        assert_eq!(figure.svg.matches("<circle").count(), 2);
        assert!(toml::from_str::<Plot>("x = 'views'").is_err());
    }
}
