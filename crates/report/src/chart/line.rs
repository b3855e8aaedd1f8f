use plotters::prelude::*;

use super::{
    Axis, Frame, Series,
    canvas::{colour, drawn, plot},
    fit_power_law,
    scale::Scale,
};
use crate::ReportError;

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

struct Line {
    name: String,
    points: Vec<(f64, f64)>,
    colour: RGBColor,
    /// Stroke in pixels; 0 for none.
    width: u32,
    marked: bool,
}

fn draw(frame: &Frame, lines: &[Line]) -> Result<String, ReportError> {
    let points = || lines.iter().flat_map(|line| line.points.iter().copied());
    let x = Scale::around(points().map(|(x, _)| x), frame.x.log);
    let y = Scale::around(points().map(|(_, y)| y), frame.y.log);
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
