//! Commands of schedulers.

use std::ffi::OsStr;
use std::io::ErrorKind;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};

/// What `program`, a command of `scheduler`, prints.
///
/// # Errors
/// If there is no such program, or it fails: with what it said, on one line.
pub(super) fn output<S: AsRef<OsStr>>(scheduler: &str, program: &str, args: &[S]) -> Result<String> {
    let output = match Command::new(program).args(args).stdin(Stdio::null()).output() {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            bail!("{program}: not found: expected {scheduler}'s commands on the PATH")
        }
        output => output.with_context(|| program.to_owned())?,
    };
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let prefix = format!("{program}: ");
        let lines = said.lines().map(|line| line.trim().trim_start_matches(&prefix).trim_start_matches("error: "));
        let said = lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ");
        match said.as_str() {
            "" => bail!("{program}: {}", output.status),
            said => bail!("{program}: {said}"),
        }
    }
    String::from_utf8(output.stdout).with_context(|| format!("{program}: expected text"))
}
