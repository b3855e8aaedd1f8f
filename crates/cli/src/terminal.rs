//! What suits the terminal, if there is one.

use std::io::IsTerminal;

use image::{RgbImage, imageops};
use infonerf_experiment::{DeviceName, OpenDevice, open};
use infonerf_report::Emphasis;
use infonerf_scene::resized_dimensions;

/// Columns of the terminal that a picture takes.
const COLUMNS: u32 = 64;

/// How the best values of tables are marked: bold on a terminal, unless `NO_COLOR` is set, and with a star elsewhere.
pub(crate) fn emphasis() -> Emphasis {
    if is_terminal() && !no_color() { Emphasis::Terminal } else { Emphasis::Star }
}

/// Whether somebody sees what is printed.
pub(crate) fn is_terminal() -> bool {
    std::io::stdout().is_terminal()
}

fn no_color() -> bool {
    std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

/// Prints a picture as coloured half blocks, two pixels per character, and nothing where `NO_COLOR` is set.
pub(crate) fn show(picture: &RgbImage) {
    if no_color() {
        return;
    }
    let (width, height) = resized_dimensions(picture.width(), picture.height(), COLUMNS);
    let small = imageops::thumbnail(picture, width, height.next_multiple_of(2));
    for y in (0..small.height()).step_by(2) {
        let block = |x| {
            let [[r, g, b], [below_r, below_g, below_b]] = [small.get_pixel(x, y).0, small.get_pixel(x, y + 1).0];
            format!("\x1b[38;2;{r};{g};{b}m\x1b[48;2;{below_r};{below_g};{below_b}m▀")
        };
        println!("{}\x1b[0m", (0..small.width()).map(block).collect::<String>());
    }
}

/// Opens a device and says which GPU it is.
pub(crate) fn open_device(name: DeviceName) -> anyhow::Result<OpenDevice> {
    let device = open(name)?;
    if let Some(adapter) = &device.adapter {
        eprintln!("{}: {adapter}", device.name);
    }
    Ok(device)
}
