//! Output that fits the terminal: widths, colours, pictures.

use std::io::IsTerminal;

use image::{RgbImage, imageops};
use infonerf_experiment::{DeviceName, OpenDevice, open};
use infonerf_report::{Emphasis, Table};
use terminal_size::{Height, Width, terminal_size_of};

use crate::print::{errln, outln};

/// Assumed size of a terminal of unknown size: columns and rows.
const SIZE: (u16, u16) = (80, 24);
/// Columns of a table that goes into a file or a pipe.
const FILE_COLUMNS: usize = 100;
/// Columns of an image, at most, and rows of the terminal that it leaves to the lines around it.
const MAX_COLUMNS: u16 = 64;
const LEFT_ROWS: u16 = 5;

/// Whether standard output is a terminal.
pub(crate) fn is_terminal() -> bool {
    std::io::stdout().is_terminal()
}

/// Formats a table as text, no wider than the terminal, or else than `COLUMNS` or [`FILE_COLUMNS`] characters.
pub(crate) fn fitted(table: &Table) -> String {
    let (columns, emphasis) = if is_terminal() {
        let columns = terminal_size_of(std::io::stdout()).map_or(SIZE.0, |(Width(columns), _)| columns);
        (columns.into(), if no_color() { Emphasis::Star } else { Emphasis::Terminal })
    } else {
        let asked = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
        (asked.filter(|columns| *columns > 0).unwrap_or(FILE_COLUMNS), Emphasis::Star)
    };
    table.narrowed(columns).to_text(emphasis)
}

/// Columns of the terminal on standard error.
pub(crate) fn columns_of_stderr() -> usize {
    terminal_size_of(std::io::stderr()).map_or(SIZE.0, |(Width(columns), _)| columns).into()
}

fn no_color() -> bool {
    std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

/// Prints a picture as coloured half blocks, two pixels per character, and nothing where `NO_COLOR` is set.
pub(crate) fn show(picture: &RgbImage) {
    if no_color() {
        return;
    }
    let (columns, rows) = terminal_size_of(std::io::stdout()).map_or(SIZE, |(Width(w), Height(h))| (w, h));
    let (columns, rows) = (columns.clamp(1, MAX_COLUMNS), rows.saturating_sub(LEFT_ROWS).max(1));
    let (width, height) = shown_size(picture.dimensions(), columns, rows);
    let small = imageops::thumbnail(picture, width, height);
    for y in (0..small.height()).step_by(2) {
        let block = |x| {
            let [[r, g, b], [below_r, below_g, below_b]] = [small.get_pixel(x, y).0, small.get_pixel(x, y + 1).0];
            format!("\x1b[38;2;{r};{g};{b}m\x1b[48;2;{below_r};{below_g};{below_b}m▀")
        };
        outln!("{}\x1b[0m", (0..small.width()).map(block).collect::<String>());
    }
}

/// Returns the size in half blocks of an image of `width` × `height` pixels, as large as `columns` and `rows` of text
/// hold.
fn shown_size((width, height): (u32, u32), columns: u16, rows: u16) -> (u32, u32) {
    let scale = (f64::from(columns) / f64::from(width)).min(2.0 * f64::from(rows) / f64::from(height));
    let [width, height] = [width, height].map(|side| ((scale * f64::from(side)).round() as u32).max(1));
    (width, height.next_multiple_of(2))
}

/// Opens a device, and prints which GPU it is.
pub(crate) fn open_device(name: DeviceName) -> anyhow::Result<OpenDevice> {
    let device = open(name)?;
    if let Some(adapter) = &device.adapter {
        errln!("{}: {adapter}", device.name);
    }
    Ok(device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_fit_the_terminal() {
        assert_eq!(shown_size((200, 200), 64, 19), (38, 38));
        assert_eq!(shown_size((400, 200), 64, 19), (64, 32));
        assert_eq!(shown_size((3, 1000), 64, 19), (1, 38));
        assert_eq!(shown_size((1000, 3), 64, 19), (64, 2));
    }
}
