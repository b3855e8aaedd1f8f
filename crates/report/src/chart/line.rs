use image::RgbImage;
use plotters::{
    prelude::*,
    style::text_anchor::{HPos, VPos},
};

use super::{
    ChartFrame, Series,
    canvas::{Area, DrawingResult, INK, anchored, colour, drawn, font, pictured, plot, text_width, zoom},
    scale::{Scale, drawable},
};
use crate::{error::ReportError, text::plain};

/// Maximum number of points of a line with a marker on each.
const MARKED: usize = 24;
/// Colour of a frontier, on white and on black.
const GREY: RGBColor = RGBColor(128, 128, 128);

/// Draws lines through the points of each series, in the order given, with a marker on each point where there are few.
///
/// # Errors
/// If the drawing library refuses.
pub fn line_chart(frame: &ChartFrame, series: &[Series]) -> Result<String, ReportError> {
    let mut lines = PlotLine::of_each(series, frame, 2);
    lines.iter_mut().for_each(|line| line.marked = line.points.len() <= MARKED);
    drawn(frame, |sheet| paint(sheet, frame, &lines, &[]))
}

/// Draws the points of each series, and a stepped line along the [`pareto_frontier`] of all of them.
///
/// # Errors
/// If the drawing library refuses.
pub fn frontier_chart(frame: &ChartFrame, series: &[Series]) -> Result<String, ReportError> {
    let mut lines = PlotLine::of_each(series, frame, 0);
    let all: Vec<(f64, f64)> = lines.iter().flat_map(|line| line.points.iter().copied()).collect();
    let points = steps(&pareto_frontier(&all), &all);
    lines.insert(0, PlotLine { name: String::new(), points, colour: GREY, width: 1, marked: false });
    drawn(frame, |sheet| paint(sheet, frame, &lines, &[]))
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

/// Returns the best `y` so far at each `x`: right along a point's level, then up to the next, on to the last of all
/// points.
fn steps(frontier: &[(f64, f64)], all: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let corners = frontier.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
    let end = all.iter().map(|point| point.0).fold(f64::NEG_INFINITY, f64::max);
    let last = frontier.last().into_iter().flat_map(|&(x, y)| [(x, y), (end, y)]);
    corners.chain(last).collect()
}

/// Published figure in a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Text next to the point.
    pub label: String,
    /// `(x, y)`.
    pub point: (f64, f64),
}

/// Chart as SVG, and as an image of twice the size.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// SVG text.
    pub svg: String,
    /// Dark lines on white.
    pub picture: RgbImage,
}

/// Draws a [`line_chart`] in which every point is marked, with `marks` in addition to the lines.
///
/// # Errors
/// If the drawing library refuses.
pub fn marked_chart(frame: &ChartFrame, series: &[Series], marks: &[Mark]) -> Result<Drawing, ReportError> {
    let lines = PlotLine::of_each(series, frame, 2);
    let fits = |mark: &&Mark| drawable(mark.point.0, frame.x.scale) && drawable(mark.point.1, frame.y.scale);
    let marks: Vec<Mark> = marks.iter().filter(fits).cloned().collect();
    Ok(Drawing {
        svg: drawn(frame, |sheet| paint(sheet, frame, &lines, &marks))?,
        picture: pictured(frame, |sheet| paint(sheet, frame, &lines, &marks))?,
    })
}

struct PlotLine {
    name: String,
    points: Vec<(f64, f64)>,
    colour: RGBColor,
    /// Stroke in pixels; 0 for none.
    width: u32,
    marked: bool,
}

impl PlotLine {
    /// Makes the line of each series, with a marker on each point and a stroke of `width`.
    fn of_each(series: &[Series], frame: &ChartFrame, width: u32) -> Vec<Self> {
        let line = |(index, series): (usize, &Series)| Self {
            name: series.name.clone(),
            points: series.drawable(frame),
            colour: colour(index),
            width,
            marked: true,
        };
        series.iter().enumerate().map(line).collect()
    }
}

fn paint<B: DrawingBackend<ErrorType: 'static>>(
    sheet: &Area<B>,
    frame: &ChartFrame,
    lines: &[PlotLine],
    marks: &[Mark],
) -> DrawingResult {
    let points =
        || lines.iter().flat_map(|line| line.points.iter().copied()).chain(marks.iter().map(|mark| mark.point));
    let x = Scale::around(points().map(|(x, _)| x), frame.x.scale);
    let y = Scale::around(points().map(|(_, y)| y), frame.y.scale);
    let legend: Vec<_> = lines.iter().map(|line| (line.name.clone(), line.colour)).collect();
    let zoom = zoom(sheet);
    let scale = zoom as i32;
    let mut plot = plot(sheet, frame, &legend, x, y)?;
    for line in lines {
        if line.width > 0 && line.points.len() > 1 {
            let style = line.colour.stroke_width(zoom * line.width);
            plot.draw_series(LineSeries::new(line.points.iter().copied(), style))?;
        }
        if line.marked {
            plot.draw_series(line.points.iter().map(|&point| Circle::new(point, 4 * scale, line.colour.filled())))?;
        }
    }
    let mut taken: Vec<[i32; 4]> = points().map(|point| around(plot.backend_coord(&point), 4 * scale)).collect();
    for Mark { label, point } in marks {
        let label = plain(label);
        let place = plot.backend_coord(point);
        let width = (f64::from(zoom) * text_width(&label, 11.0)) as i32;
        let (corner, taken_by) = free_place(place, width, scale, &taken, sheet.dim_in_pixel().0 as i32);
        taken.push(taken_by);
        plot.draw_series([Circle::new(*point, 4 * scale, INK.stroke_width(zoom))])?;
        sheet.draw(&Text::new(label, corner, anchored(font(11.0 * f64::from(zoom)), HPos::Left, VPos::Top)))?;
    }
    Ok(())
}

/// Returns the square around a place, as left, top, right, bottom.
fn around((x, y): (i32, i32), reach: i32) -> [i32; 4] {
    [x - reach, y - reach, x + reach, y + reach]
}

/// Returns the upper left corner and the box of a label of `width` pixels right or left of a mark, on its line or up to
/// three above or below: the first place on the sheet that overlaps none of `taken`.
fn free_place((x, y): (i32, i32), width: i32, zoom: i32, taken: &[[i32; 4]], sheet: i32) -> ((i32, i32), [i32; 4]) {
    let (gap, height) = (8 * zoom, 14 * zoom);
    let at = |left: i32, line: i32| {
        let top = y - height / 2 + line * height;
        ((left, top), [left, top, left + width, top + height])
    };
    let meets = |a: &[i32; 4], b: &[i32; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    let free = |(_, own): &((i32, i32), [i32; 4])| {
        own[0] > 64 * zoom && own[2] < sheet && !taken.iter().any(|other| meets(own, other))
    };
    let mut places =
        [0, -1, 1, -2, 2, -3, 3].into_iter().flat_map(|line| [at(x + gap, line), at(x - gap - width, line)]);
    places.find(free).unwrap_or_else(|| at(x - gap - width, 0))
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
