//! Output that fits the terminal, and what opens with a message.

use std::io::IsTerminal;
use std::path::Path;

use infonerf_experiment::{DeviceName, OpenDevice, RunPlan, Trained, open};
use infonerf_report::Table;
use terminal_size::{Width, terminal_size_of};

use crate::print::errln;
use crate::progress::with_spinner;

/// Columns of a terminal of unknown size.
const COLUMNS: u16 = 80;
/// Columns of a table that goes into a file or a pipe.
const FILE_COLUMNS: usize = 100;

pub(crate) fn is_terminal() -> bool {
    std::io::stdout().is_terminal()
}

/// Formats a table as text, no wider than the terminal, or else than `COLUMNS` or [`FILE_COLUMNS`] characters.
pub(crate) fn fitted(table: &Table) -> String {
    let columns = if is_terminal() {
        usize::from(terminal_size_of(std::io::stdout()).map_or(COLUMNS, |(Width(columns), _)| columns))
    } else {
        let asked = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
        asked.filter(|columns| *columns > 0).unwrap_or(FILE_COLUMNS)
    };
    table.narrowed(columns).to_text()
}

/// Opens a device, and prints which GPU it is.
pub(crate) fn open_device(name: DeviceName) -> anyhow::Result<OpenDevice> {
    let device = open(name)?;
    if let Some(adapter) = &device.adapter {
        errln!("{}: {adapter}", device.name);
    }
    Ok(device)
}

/// Reads the fields of the run in `folder`, and prints the warnings of reading.
pub(crate) fn read_run(plan: RunPlan, folder: &Path, device: &OpenDevice) -> anyhow::Result<Trained> {
    let reading = format!("{}: reading the run", folder.display());
    let trained = with_spinner(reading, || Trained::read(plan, folder, device))?;
    trained.warnings.iter().for_each(|warning| errln!("warning: {warning}"));
    Ok(trained)
}
