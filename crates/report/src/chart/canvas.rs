//! Parts of every chart: the sheet, its title and legend, and the plotting area with its axes.

use std::sync::Once;

use epaint_default_fonts::UBUNTU_LIGHT;
use image::RgbImage;
use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::register_font;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{ChartFrame, scale::Scale};
use crate::error::ReportError;
use crate::text::plain;

/// Placeholder of the surrounding text's colour, which [`drawn`] replaces: no chart uses it for anything else.
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
/// Approximate ratio of a character's width to the font size.
const CHARACTER: f64 = 0.56;
/// Factor by which the drawing library divides font sizes.
const FONT_SCALE: f64 = 1.24;

/// Size of the labels that [`write_text`] writes, in pixels.
pub(crate) const LABEL: f64 = 14.0;

pub(super) type Area<'s> = DrawingArea<SVGBackend<'s>, Shift>;
pub(super) type Plot<'a, 's> = ChartContext<'a, SVGBackend<'s>, Cartesian2d<Scale, Scale>>;
pub(super) type DrawingResult = Result<(), Box<dyn std::error::Error>>;

pub(super) fn colour(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

pub(super) fn font<'a>(pixels: f64) -> TextStyle<'a> {
    ("sans-serif", pixels * FONT_SCALE).into_font().color(&INK)
}

pub(super) fn anchored<'a>(style: TextStyle<'a>, h: HPos, v: VPos) -> TextStyle<'a> {
    style.pos(Pos::new(h, v))
}

fn register_fonts() {
    static ONCE: Once = Once::new();
    // If the font cannot be read, the first chart that uses it reports the error.
    ONCE.call_once(|| drop(register_font("sans-serif", FontStyle::Normal, UBUNTU_LIGHT)));
}

/// Writes texts, each with the place of its upper left corner, on an image.
pub(crate) fn write_text(picture: &mut RgbImage, texts: &[(String, (i32, i32))]) -> Result<(), ReportError> {
    register_fonts();
    let size = picture.dimensions();
    let sheet = BitMapBackend::with_buffer(picture, size).into_drawing_area();
    for (text, place) in texts {
        let text = Text::new(plain(text), *place, anchored(font(LABEL), HPos::Left, VPos::Top));
        sheet.draw(&text).map_err(ReportError::chart("labels"))?;
    }
    sheet.present().map_err(ReportError::chart("labels"))
}

pub(super) fn drawn(frame: &ChartFrame, draw: impl FnOnce(&Area<'_>) -> DrawingResult) -> Result<String, ReportError> {
    register_fonts();
    let mut svg = String::new();
    let outcome = {
        let sheet = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        draw(&sheet).and_then(|()| Ok(sheet.present()?))
    };
    outcome.map_err(ReportError::chart(&frame.title))?;
    Ok(svg.replace(INK_CODE, "currentColor"))
}

/// Draws title, legend (names and colours, but for entries without a name) and axes, and returns the plot to draw into.
pub(super) fn plot<'a, 's>(
    sheet: &'a Area<'s>,
    frame: &ChartFrame,
    legend: &[(String, RGBColor)],
    x: Scale,
    y: Scale,
) -> Result<Plot<'a, 's>, Box<dyn std::error::Error>> {
    let mut top = 12;
    if !frame.title.is_empty() {
        let bold = ("sans-serif", 13.5 * FONT_SCALE, FontStyle::Bold).into_font().color(&INK);
        sheet.draw(&Text::new(plain(&frame.title), (16, top), anchored(bold, HPos::Left, VPos::Top)))?;
        top += 24;
    }
    top = draw_legend(sheet, legend, top)?;

    let mut chart = ChartBuilder::on(sheet);
    chart.margin_left(6).margin_right(20).margin_bottom(6).margin_top(top + 4);
    chart.set_label_area_size(LabelAreaPosition::Left, 58);
    chart.set_label_area_size(LabelAreaPosition::Bottom, 42);
    let mut plot = chart.build_cartesian_2d(x, y)?;
    plot.configure_mesh()
        .max_light_lines(0)
        .bold_line_style(INK.mix(0.12))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.mix(0.5))
        .label_style(font(11.0))
        .axis_desc_style(font(12.0))
        .x_desc(plain(&frame.x))
        .y_desc(plain(&frame.y))
        .draw()?;
    Ok(plot)
}

pub(super) fn fits_below(label: &str, places: usize) -> bool {
    text_width(label, 11.0) < f64::from(WIDTH - 58 - 26) / places.max(1) as f64
}

/// Draws names in rows from the left, and returns where they end.
fn draw_legend(sheet: &Area<'_>, legend: &[(String, RGBColor)], top: i32) -> Result<i32, Box<dyn std::error::Error>> {
    let (mut left, mut row) = (16, top);
    let named: Vec<_> = legend.iter().filter(|(name, _)| !name.is_empty()).collect();
    if named.is_empty() {
        return Ok(top);
    }
    for (name, colour) in named {
        let name = plain(name);
        let width = 40 + text_width(&name, 12.0) as i32;
        if left > 16 && left + width > WIDTH as i32 {
            (left, row) = (16, row + 18);
        }
        if row > HEIGHT as i32 / 3 {
            break;
        }
        sheet.draw(&Rectangle::new([(left, row + 4), (left + 18, row + 8)], colour.filled()))?;
        sheet.draw(&Text::new(name, (left + 24, row + 6), anchored(font(12.0), HPos::Left, VPos::Center)))?;
        left += width;
    }
    Ok(row + 18)
}

pub(crate) fn text_width(text: &str, pixels: f64) -> f64 {
    text.chars().count() as f64 * pixels * CHARACTER
}
