//! What all charts share: the sheet, its title and legend, and the plotting area with its axes.

use plotters::{
    chart::ChartContext,
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{Frame, scale::Scale};
use crate::{ReportError, text::plain};

/// Stands for the colour of the surrounding text until [`drawn`] replaces it: no chart uses it for anything else.
pub(super) const INK: RGBColor = RGBColor(1, 2, 3);
const INK_CODE: &str = "#010203";
/// Eight colours that the colour-blind can tell apart, on white and on black (after Okabe and Ito).
const PALETTE: [RGBColor; 8] = [
    RGBColor(0, 126, 196),
    RGBColor(222, 98, 14),
    RGBColor(0, 158, 115),
    RGBColor(196, 108, 158),
    RGBColor(216, 150, 0),
    RGBColor(72, 170, 222),
    RGBColor(140, 110, 80),
    RGBColor(128, 128, 128),
];
const WIDTH: u32 = 520;
const HEIGHT: u32 = 320;
/// Width of a character over the font size, about.
const CHARACTER: f64 = 0.56;
/// The drawing library divides sizes by this.
const FONT_SCALE: f64 = 1.24;

pub(super) type Backend<'a> = SVGBackend<'a>;
pub(super) type Area<'a> = DrawingArea<Backend<'a>, Shift>;
pub(super) type Plot<'a, 'b> = ChartContext<'a, Backend<'b>, Cartesian2d<Scale, Scale>>;
pub(super) type Outcome = Result<(), Box<dyn std::error::Error>>;

pub(super) fn colour(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

pub(super) fn font<'a>(pixels: f64) -> TextStyle<'a> {
    ("sans-serif", pixels * FONT_SCALE).into_font().color(&INK)
}

pub(super) fn anchored<'a>(style: TextStyle<'a>, h: HPos, v: VPos) -> TextStyle<'a> {
    style.pos(Pos::new(h, v))
}

/// Draws on a sheet and returns its SVG.
pub(super) fn drawn(frame: &Frame, draw: impl FnOnce(&Area) -> Outcome) -> Result<String, ReportError> {
    let mut svg = String::new();
    let outcome = {
        let sheet = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        draw(&sheet).and_then(|()| Ok(sheet.present()?))
    };
    outcome.map_err(|error| ReportError::Chart { title: frame.title.clone(), reason: error.to_string() })?;
    Ok(svg.replace(INK_CODE, "currentColor"))
}

/// Title, then legend, then axes; the plot that is returned is ready to be drawn into.
///
/// `legend` holds names and colours; a single nameless entry needs none.
pub(super) fn plot<'a, 'b>(
    sheet: &'a Area<'b>,
    frame: &Frame,
    legend: &[(String, RGBColor)],
    x: Scale,
    y: Scale,
) -> Result<Plot<'a, 'b>, Box<dyn std::error::Error>> {
    let mut top = 12;
    if !frame.title.is_empty() {
        let bold = ("sans-serif", 13.5 * FONT_SCALE, FontStyle::Bold).into_font().color(&INK);
        let bold = anchored(bold, HPos::Left, VPos::Top);
        sheet.draw(&Text::new(plain(&frame.title), (16, top), bold))?;
        top += 24;
    }
    top = draw_legend(sheet, legend, top)?;

    let mut chart = ChartBuilder::on(sheet);
    chart.margin_left(6).margin_right(20).margin_bottom(6).margin_top(top + 4);
    chart.set_label_area_size(LabelAreaPosition::Left, 58).set_label_area_size(LabelAreaPosition::Bottom, 42);
    let mut plot = chart.build_cartesian_2d(x, y)?;
    plot.configure_mesh()
        .max_light_lines(0)
        .bold_line_style(INK.mix(0.12))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.mix(0.5))
        .label_style(font(11.0))
        .axis_desc_style(font(12.0))
        .x_desc(plain(&frame.x.label))
        .y_desc(plain(&frame.y.label))
        .draw()?;
    Ok(plot)
}

/// Whether a label has room below one of `places` bars.
pub(super) fn fits_below(label: &str, places: usize) -> bool {
    let room = f64::from(WIDTH - 58 - 26) / places.max(1) as f64;
    label.chars().count() as f64 * 11.0 * CHARACTER < room
}

/// Names in rows from the left; returns where they end.
fn draw_legend(sheet: &Area, legend: &[(String, RGBColor)], top: i32) -> Result<i32, Box<dyn std::error::Error>> {
    let (mut left, mut row) = (16, top);
    let named: Vec<_> = legend.iter().filter(|(name, _)| !name.is_empty()).collect();
    if named.is_empty() {
        return Ok(top);
    }
    for (name, colour) in named {
        let name = plain(name);
        let width = 26 + (name.chars().count() as f64 * 12.0 * CHARACTER) as i32 + 14;
        if left > 16 && left + width > WIDTH as i32 {
            (left, row) = (16, row + 18);
        }
        if row > HEIGHT as i32 / 3 {
            break;
        }
        sheet.draw(&Rectangle::new([(left, row + 4), (left + 18, row + 8)], colour.filled()))?;
        let style = anchored(font(12.0), HPos::Left, VPos::Center);
        sheet.draw(&Text::new(name, (left + 24, row + 6), style))?;
        left += width;
    }
    Ok(row + 18)
}
