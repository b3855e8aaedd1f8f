use image::RgbImage;
use plotters::{
    prelude::*,
    style::text_anchor::{HPos, VPos},
};

use super::{
    Axis, Frame, Series,
    canvas::{Area, INK, Outcome, anchored, colour, drawn, font, pictured, plot, text_width, zoom},
    fit_power_law,
    scale::{Scale, drawable},
};
use crate::{ReportError, text::plain};

const MARKED: usize = 24;

/// Lines through the points of each series, in the order given, with a marker on each point where there are few.
///
/// # Errors
/// [`ReportError::Chart`] when the drawing library refuses.
pub fn line_chart(frame: &Frame, series: &[Series]) -> Result<String, ReportError> {
    let lines: Vec<Line> = series
        .iter()
        .enumerate()
        .map(|(index, series)| {
            let points = series.drawable(frame);
            Line { name: series.name.clone(), marked: points.len() <= MARKED, points, colour: colour(index), width: 2 }
        })
        .collect();
    draw(frame, &lines)
}

/// Points on logarithmic axes with the [`fit_power_law`] of each series as a line, its exponent in the legend: `flex:
/// x^0.98`.
///
/// # Errors
/// [`ReportError::Chart`] when the drawing library refuses.
pub fn power_law_chart(frame: &Frame, series: &[Series]) -> Result<String, ReportError> {
    let log = |axis: &Axis| Axis { log: true, ..axis.clone() };
    let frame = Frame { title: frame.title.clone(), x: log(&frame.x), y: log(&frame.y) };
    let mut lines = Vec::new();
    for (index, series) in series.iter().enumerate() {
        let points = series.drawable(&frame);
        let law = fit_power_law(&points);
        let name = law.map_or(series.name.clone(), |law| format!("{}: x^{:.2}", series.name, law.exponent));
        if let Some(law) = law {
            let ends = points.iter().map(|(x, _)| *x).fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
            let fitted = Series { points: [ends.0, ends.1].map(|x| (x, law.at(x))).to_vec(), ..Series::default() };
            let points = fitted.drawable(&frame);
            lines.push(Line { name, marked: false, points, colour: colour(index), width: 1 });
            lines.push(Line {
                name: String::new(),
                marked: true,
                points: series.drawable(&frame),
                colour: colour(index),
                width: 0,
            });
        } else {
            lines.push(Line { name, marked: true, points, colour: colour(index), width: 0 });
        }
    }
    draw(&frame, &lines)
}

/// Somebody else's figure in a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Written beside it.
    pub label: String,
    /// `(x, y)`.
    pub point: (f64, f64),
}

/// A chart as text, and as a picture of twice the size.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// The SVG.
    pub svg: String,
    /// Dark lines on white.
    pub picture: RgbImage,
}

/// As [`line_chart`], with every point marked, and with `marks` beside the lines.
///
/// # Errors
/// [`ReportError::Chart`] when the drawing library refuses.
pub fn marked_chart(frame: &Frame, series: &[Series], marks: &[Mark]) -> Result<Drawing, ReportError> {
    let line = |(index, series): (usize, &Series)| Line {
        name: series.name.clone(),
        points: series.drawable(frame),
        colour: colour(index),
        width: 2,
        marked: true,
    };
    let lines: Vec<Line> = series.iter().enumerate().map(line).collect();
    let fits = |mark: &&Mark| drawable(mark.point.0, frame.x.log) && drawable(mark.point.1, frame.y.log);
    let marks: Vec<Mark> = marks.iter().filter(fits).cloned().collect();
    Ok(Drawing {
        svg: drawn(frame, |sheet| paint(sheet, frame, &lines, &marks))?,
        picture: pictured(frame, |sheet| paint(sheet, frame, &lines, &marks))?,
    })
}

struct Line {
    name: String,
    points: Vec<(f64, f64)>,
    colour: RGBColor,
    /// Stroke in pixels; 0 for none.
    width: u32,
    marked: bool,
}

fn draw(frame: &Frame, lines: &[Line]) -> Result<String, ReportError> {
    drawn(frame, |sheet| paint(sheet, frame, lines, &[]))
}

fn paint<B: DrawingBackend<ErrorType: 'static>>(
    sheet: &Area<B>,
    frame: &Frame,
    lines: &[Line],
    marks: &[Mark],
) -> Outcome {
    let points =
        || lines.iter().flat_map(|line| line.points.iter().copied()).chain(marks.iter().map(|mark| mark.point));
    let x = Scale::around(points().map(|(x, _)| x), frame.x.log);
    let y = Scale::around(points().map(|(_, y)| y), frame.y.log);
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

/// The square around a place, as left, top, right, bottom.
fn around((x, y): (i32, i32), reach: i32) -> [i32; 4] {
    [x - reach, y - reach, x + reach, y + reach]
}

/// Upper left corner and box of a label of so many pixels right or left of a mark, on its line or up to three above or
/// below, whichever first meets nothing that is there and stays on the sheet.
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
