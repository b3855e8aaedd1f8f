//! The command line of this process, for other processes to run again.

use std::ffi::OsString;
use std::path::Path;

use anyhow::{Context, Result, bail};
use infonerf_report::write_atomically;

use crate::print::errln;

/// The file in an experiment's folder that holds its command line.
const FILE: &str = "command.txt";

/// Saves the command line in an experiment's folder, without `--out`.
fn save(folder: &Path) -> Result<()> {
    let mut words = vec!["infonerf".to_owned()];
    let mut args = std::env::args_os().skip(1);
    while let Some(word) = args.next() {
        match word.into_string() {
            Ok(word) if word == "--out" => drop(args.next()),
            Ok(word) if word.starts_with("--out=") => {}
            Ok(word) => words.push(word),
            Err(word) => bail!("the command line is not saved: {} is no Unicode", word.display()),
        }
    }
    let line = shlex::try_join(words.iter().map(String::as_str)).context("the command line")?;
    Ok(write_atomically(&folder.join(FILE), line.as_bytes())?)
}

pub(crate) fn save_or_warn(folder: &Path) {
    if let Err(error) = save(folder) {
        errln!("warning: {error:#}");
    }
}

pub(crate) fn read(folder: &Path) -> Option<String> {
    std::fs::read_to_string(folder.join(FILE)).ok()
}

pub(crate) fn merging() -> Result<Vec<OsString>> {
    let program = std::env::current_exe().context("the program's own file")?;
    let given = std::env::args_os().skip(1);
    Ok(std::iter::once(program.into_os_string()).chain(given).chain(["--merge".into()]).collect())
}
