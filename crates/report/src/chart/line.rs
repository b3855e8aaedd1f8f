use plotters::prelude::*;

use super::canvas::{colour, drawn, plot};
use super::scale::{Scale, drawable};
use super::{ChartFrame, Series};
use crate::error::ReportError;

/// Maximum number of points of a line with a marker on each.
const MARKED: usize = 24;
const GREY: RGBColor = RGBColor(128, 128, 128);

struct PlotLine {
    name: String,
    points: Vec<(f64, f64)>,
    colour: RGBColor,
    /// Width of the stroke in pixels; 0 for no stroke.
    width: u32,
    marked: bool,
}

/// Draws lines through the points of each series, in the order given, with markers on the points of series that have few.
pub fn line_chart(frame: &ChartFrame, series: &[Series]) -> Result<String, ReportError> {
    let mut lines = lines(series, frame, 2);
    lines.iter_mut().for_each(|line| line.marked = line.points.len() <= MARKED);
    draw(frame, &lines)
}

/// Draws the points of each series, and a stepped line along the [`pareto_frontier`] of all of them.
pub fn frontier_chart(frame: &ChartFrame, series: &[Series]) -> Result<String, ReportError> {
    let mut lines = lines(series, frame, 0);
    let all: Vec<(f64, f64)> = lines.iter().flat_map(|line| line.points.iter().copied()).collect();
    let points = steps(&pareto_frontier(&all), &all);
    lines.insert(0, PlotLine { name: String::new(), points, colour: GREY, width: 1, marked: false });
    draw(frame, &lines)
}

/// Returns the points that no other beats in both coordinates, where smaller `x` and larger `y` are better, sorted by
/// `x`: the frontier of time against PSNR. Points that are not finite are left out.
pub fn pareto_frontier(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<(f64, f64)> = points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
    let mut frontier: Vec<(f64, f64)> = Vec::new();
    for point in sorted {
        if frontier.last().is_none_or(|last| point.1 > last.1) {
            frontier.push(point);
        }
    }
    frontier
}

/// Returns the corners of a stepped line: the max `y` of `frontier` up to each `x`, continued to the max `x` of `all`.
fn steps(frontier: &[(f64, f64)], all: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let corners = frontier.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
    let end = all.iter().map(|point| point.0).fold(f64::NEG_INFINITY, f64::max);
    let last = frontier.last().into_iter().flat_map(|&(x, y)| [(x, y), (end, y)]);
    corners.chain(last).collect()
}

/// Makes the line of each series, with a marker on each point and a stroke of `width`.
fn lines(series: &[Series], frame: &ChartFrame, width: u32) -> Vec<PlotLine> {
    let fits = |&(x, y): &(f64, f64)| drawable(x, frame.log_x) && drawable(y, frame.log_y);
    let line = |(index, series): (usize, &Series)| PlotLine {
        name: series.name.clone(),
        points: series.points.iter().copied().filter(fits).collect(),
        colour: colour(index),
        width,
        marked: true,
    };
    series.iter().enumerate().map(line).collect()
}

fn draw(frame: &ChartFrame, lines: &[PlotLine]) -> Result<String, ReportError> {
    let points = || lines.iter().flat_map(|line| line.points.iter().copied());
    let x = Scale::around(points().map(|(x, _)| x), frame.log_x);
    let y = Scale::around(points().map(|(_, y)| y), frame.log_y);
    let legend: Vec<_> = lines.iter().map(|line| (line.name.clone(), line.colour)).collect();
    drawn(frame, |sheet| {
        let mut plot = plot(sheet, frame, &legend, x, y)?;
        for line in lines {
            if line.width > 0 && line.points.len() > 1 {
                plot.draw_series(LineSeries::new(line.points.iter().copied(), line.colour.stroke_width(line.width)))?;
            }
            if line.marked {
                plot.draw_series(line.points.iter().map(|&point| Circle::new(point, 4, line.colour.filled())))?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frontier_only_rises() {
        let points = [(5.0, 1.0), (1.0, 2.0), (3.0, 4.0), (2.0, 1.0), (3.0, 3.0), (4.0, 4.0), (f64::NAN, 9.0)];
        assert_eq!(pareto_frontier(&points), [(1.0, 2.0), (3.0, 4.0)]);
    }
}
