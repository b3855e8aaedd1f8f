//! Commands for any other scheduler.

use anyhow::Result;

use super::script::quoted;
use super::{Batch, Runner};

/// A command for each item of `batch`, as a shell reads it. Each may run on any machine that has the program and the
/// manifest's folder, at any time and more than once.
///
/// # Errors
/// If a path is not UTF-8.
pub fn commands(batch: &Batch, runner: &Runner) -> Result<Vec<String>> {
    let command = quoted(&runner.command(&batch.manifest))?;
    Ok(batch.items.iter().map(|item| format!("{command} {item}")).collect())
}
