use plotters::{
    prelude::*,
    style::text_anchor::{HPos, VPos},
};

use super::{
    ChartFrame,
    canvas::{INK, anchored, drawn, font, plot},
    scale::{Scale, drawable, short},
};
use crate::{
    colormap::{to_bytes, viridis},
    error::ReportError,
    text::plain,
};

/// Draws a grid of coloured cells with their values written in: `values[row][column]`, the first row on top, dark is
/// the smallest.
///
/// A value that is `None`, not finite or missing leaves its cell empty; values beyond the labels are not drawn.
///
/// # Errors
/// If the drawing library refuses.
pub fn heat_map(
    frame: &ChartFrame,
    columns: &[String],
    rows: &[String],
    values: &[Vec<Option<f64>>],
) -> Result<String, ReportError> {
    let cells: Vec<(usize, usize, f64)> = values
        .iter()
        .take(rows.len())
        .enumerate()
        .flat_map(|(row, line)| line.iter().take(columns.len()).enumerate().map(move |(column, v)| (row, column, *v)))
        .filter_map(|(row, column, value)| Some((row, column, value.filter(|value| drawable(*value, false))?)))
        .collect();
    let least = cells.iter().map(|cell| cell.2).fold(f64::INFINITY, f64::min);
    let most = cells.iter().map(|cell| cell.2).fold(f64::NEG_INFINITY, f64::max);
    let shade = |value: f64| if most > least { ((value - least) / (most - least)) as f32 } else { 0.5 };
    let decimals = if most.abs().max(least.abs()) < 1.0 { 3 } else { 2 };

    let x = Scale::labels(columns.iter().map(|label| plain(label)).collect());
    let y = Scale::labels(rows.iter().rev().map(|label| plain(label)).collect());
    drawn(frame, |sheet| {
        let mut plot = plot(sheet, frame, &[], x, y)?;
        for &(row, column, value) in &cells {
            let [r, g, b] = to_bytes(viridis(shade(value)));
            let (left, bottom) = (column as f64, (rows.len() - 1 - row) as f64);
            let body = [(left + 0.02, bottom + 0.98), (left + 0.98, bottom + 0.02)];
            plot.draw_series([Rectangle::new(body, RGBColor(r, g, b).filled())])?;
            let ink = if shade(value) > 0.6 { RGBColor(20, 20, 20) } else { RGBColor(250, 250, 250) };
            let style = anchored(font(11.0), HPos::Center, VPos::Center).color(&ink);
            plot.draw_series([Text::new(short(value, decimals), (left + 0.5, bottom + 0.5), style)])?;
        }
        if cells.is_empty() {
            let style = anchored(font(12.0), HPos::Center, VPos::Center).color(&INK);
            sheet.draw(&Text::new("no values", (280, 160), style))?;
        }
        Ok(())
    })
}
