use plotters::{
    prelude::*,
    style::text_anchor::{HPos, VPos},
};

use super::{
    ChartFrame,
    canvas::{INK, anchored, colour, drawn, fits_below, font, plot},
    scale::{Scale, drawable},
};
use crate::{error::ReportError, text::plain};

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
///
/// # Errors
/// If the drawing library refuses.
pub fn bar_chart(frame: &ChartFrame, bars: &[Bar]) -> Result<String, ReportError> {
    let spread = |bar: &Bar| bar.spread.filter(|spread| drawable(*spread, false)).unwrap_or(0.0).abs();
    let ends = bars.iter().flat_map(|bar| [bar.value - spread(bar), 1.05 * (bar.value + spread(bar))]);
    // Names that are wider than their bars' places go into a legend.
    let labels: Vec<String> = bars.iter().map(|bar| plain(&bar.label)).collect();
    let fit = labels.iter().all(|label| fits_below(label, bars.len()));
    let legend = labels.iter().enumerate().map(|(index, label)| (label.clone(), colour(index)));
    let legend: Vec<(String, RGBColor)> = if fit { Vec::new() } else { legend.collect() };
    let x = Scale::labels(if fit { labels } else { vec![String::new(); bars.len()] });
    let y = Scale::around(ends.chain([0.0]), false).with_zero();
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
