use plotters::prelude::*;

use super::{
    Frame, Series,
    canvas::{INK, colour, drawn, plot},
    pareto_frontier,
    scale::Scale,
};
use crate::ReportError;

/// Points of each series; with `frontier`, a stepped line along the [`pareto_frontier`] of all of them (smaller `x`
/// and larger
/// `y` are better).
///
/// # Errors
/// [`ReportError::Chart`] when the drawing library refuses.
pub fn scatter_chart(frame: &Frame, series: &[Series], frontier: bool) -> Result<String, ReportError> {
    let points: Vec<Vec<(f64, f64)>> = series.iter().map(|series| series.drawable(frame)).collect();
    let all: Vec<(f64, f64)> = points.iter().flatten().copied().collect();
    let x = Scale::around(all.iter().map(|point| point.0), frame.x.log);
    let y = Scale::around(all.iter().map(|point| point.1), frame.y.log);
    let legend: Vec<_> = series.iter().enumerate().map(|(index, s)| (s.name.clone(), colour(index))).collect();
    drawn(frame, |sheet| {
        let mut plot = plot(sheet, frame, &legend, x, y)?;
        if frontier {
            let steps = steps(&pareto_frontier(&all), &all);
            plot.draw_series(LineSeries::new(steps, INK.mix(0.45).stroke_width(1)))?;
        }
        for (index, points) in points.iter().enumerate() {
            plot.draw_series(points.iter().map(|&point| Circle::new(point, 5, colour(index).filled())))?;
        }
        Ok(())
    })
}

/// What is the best so far at each `x`: right along a point's level, then up to the next, on to the last of all points.
fn steps(frontier: &[(f64, f64)], all: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let corners = frontier.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
    let end = all.iter().map(|point| point.0).fold(f64::NEG_INFINITY, f64::max);
    let last = frontier.last().into_iter().flat_map(|&(x, y)| [(x, y), (end, y)]);
    corners.chain(last).collect()
}
