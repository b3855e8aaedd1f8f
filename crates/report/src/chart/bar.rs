use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::ChartFrame;
use super::canvas::{INK, anchored, colour, drawn, fits_below, font, plot};
use super::scale::{Scale, drawable, short};
use crate::colormap::{to_bytes, viridis};
use crate::error::ReportError;
use crate::text::plain;

/// Bar of a [`bar_chart`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bar {
    /// Name below the bar.
    pub label: String,
    /// Height. A bar whose value is not finite keeps its place and is empty.
    pub value: f64,
    /// Half length of the whisker, such as a standard deviation; `None` for no whisker.
    pub spread: Option<f64>,
}

/// Draws a bar for each entry, from zero, its value written above. The frame's axes are taken as linear.
pub fn bar_chart(frame: &ChartFrame, bars: &[Bar]) -> Result<String, ReportError> {
    let spread = |bar: &Bar| bar.spread.filter(|spread| drawable(*spread, false)).unwrap_or(0.0).abs();
    let ends = bars.iter().flat_map(|bar| [bar.value - spread(bar), 1.05 * (bar.value + spread(bar))]);
    // If a label does not fit below its bar, all labels go into a legend.
    let labels: Vec<String> = bars.iter().map(|bar| plain(&bar.label)).collect();
    let fit = labels.iter().all(|label| fits_below(label, bars.len()));
    let legend = labels.iter().enumerate().map(|(index, label)| (label.clone(), colour(index)));
    let legend: Vec<(String, RGBColor)> = if fit { Vec::new() } else { legend.collect() };
    let x = Scale::labels(if fit { labels } else { vec![String::new(); bars.len()] });
    let y = Scale::around(ends.chain([0.0]), false);
    drawn(frame, |sheet| {
        let mut plot = plot(sheet, frame, &legend, x, y)?;
        for (index, bar) in bars.iter().enumerate().filter(|(_, bar)| drawable(bar.value, false)) {
            let (left, middle, right) = (index as f64 + 0.2, index as f64 + 0.5, index as f64 + 0.8);
            let body = Rectangle::new([(left, 0.0), (right, bar.value)], colour(index).filled());
            plot.draw_series([body])?;
            let reach = spread(bar);
            if reach > 0.0 {
                let whisker = vec![(middle, bar.value - reach), (middle, bar.value + reach)];
                plot.draw_series([PathElement::new(whisker, INK.stroke_width(2))])?;
            }
            let style = anchored(font(11.0), HPos::Center, VPos::Bottom);
            let top = (middle, bar.value.max(0.0) + reach);
            plot.draw_series([Text::new(format!("{:.2}", bar.value), top, style)])?;
        }
        Ok(())
    })
}

/// Draws a grid of coloured cells with their `values[row][column]`, the first row on top; dark is the smallest.
///
/// A value that is `None`, not finite or missing leaves its cell empty; values beyond the labels are not drawn.
pub fn heat_map(
    frame: &ChartFrame,
    columns: &[String],
    rows: &[String],
    values: &[Vec<Option<f64>>],
) -> Result<String, ReportError> {
    let of_row = |(row, line): (usize, &Vec<Option<f64>>)| {
        let shown = line.iter().map(|value| value.filter(|value| drawable(*value, false)));
        let cells = shown.take(columns.len()).enumerate();
        cells.filter_map(|(column, value)| Some((row, column, value?))).collect::<Vec<_>>()
    };
    let cells: Vec<(usize, usize, f64)> = values.iter().take(rows.len()).enumerate().flat_map(of_row).collect();
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
