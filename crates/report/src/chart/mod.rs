//! Charts as SVG strings.
//!
//! Lines and text take the colour of the text around them (`currentColor`), so that a chart inside a page follows its
//! light or dark scheme; [`standalone`] makes a file of a chart. Points that are not finite, or not positive on a
//! logarithmic axis, are left out; a chart without points is drawn empty.

mod bar;
mod canvas;
mod line;
mod scale;

pub use bar::{Bar, bar_chart, heat_map};
pub(crate) use canvas::{LABEL, text_width, write_text};
pub use line::{frontier_chart, line_chart, pareto_frontier};

/// Title and axes of a chart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ChartFrame {
    /// Heading above the chart; may be empty.
    pub title: String,
    /// Label of the horizontal axis: quantity and unit.
    pub x: String,
    /// Label of the vertical axis.
    pub y: String,
    /// Whether the horizontal axis is logarithmic: values that are not positive are left out.
    pub log_x: bool,
    /// Whether the vertical axis is logarithmic.
    pub log_y: bool,
}

/// Named set of points, in one colour.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Name in the legend; may be empty.
    pub name: String,
    /// Points `(x, y)`.
    pub points: Vec<(f64, f64)>,
}

impl ChartFrame {
    /// Returns a frame with linear axes.
    pub fn new(title: &str, x: &str, y: &str) -> Self {
        Self { title: title.into(), x: x.into(), y: y.into(), ..Self::default() }
    }
}

/// Returns a chart as a file of its own: dark lines on white.
pub fn standalone(svg: &str) -> String {
    svg.replacen("<svg ", "<svg style=\"color:#1f2328;background:#fff\" ", 1)
}
