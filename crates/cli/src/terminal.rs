//! What suits the terminal, if there is one.

use std::io::IsTerminal;

use infonerf_experiment::{DeviceName, OpenDevice, open};
use infonerf_report::Emphasis;

/// How the best values of tables are marked: bold on a terminal, unless `NO_COLOR` is set, and with a star elsewhere.
pub(crate) fn emphasis() -> Emphasis {
    let plain = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    if std::io::stdout().is_terminal() && !plain { Emphasis::Terminal } else { Emphasis::Star }
}

/// Opens a device and says which GPU it is.
pub(crate) fn open_device(name: DeviceName) -> anyhow::Result<OpenDevice> {
    let device = open(name)?;
    if let Some(adapter) = &device.adapter {
        eprintln!("{}: {adapter}", device.name);
    }
    Ok(device)
}
