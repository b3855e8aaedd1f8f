//! Printing to standard output and standard error. A closed pipe is no error: the run continues.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::OnceLock;

/// The error of standard output, if it could not be written to.
static FAULT: OnceLock<io::Error> = OnceLock::new();

/// Prints a line as `println!` does, without its panic.
macro_rules! outln {
    ($($text:tt)*) => { crate::print::out(format_args!("{}\n", format_args!($($text)*))) };
}

/// Prints a line as `eprintln!` does, without its panic.
macro_rules! errln {
    ($($text:tt)*) => { crate::print::err(format_args!("{}\n", format_args!($($text)*))) };
}

pub(crate) use {errln, outln};

/// Returns `path` as a word of a shell's command.
pub(crate) fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    shlex::try_quote(&text).map_or_else(|_| text.clone(), Into::into)
}

/// Writes to standard output. A closed pipe is ignored; any other error is kept for [`fault`].
pub(crate) fn out(text: fmt::Arguments<'_>) {
    keep(io::stdout().write_fmt(text));
}

pub(crate) fn err(text: fmt::Arguments<'_>) {
    let _ = io::stderr().write_fmt(text);
}

/// Returns the first error of standard output, except that of a closed pipe.
pub(crate) fn fault() -> Option<&'static io::Error> {
    keep(io::stdout().flush());
    FAULT.get()
}

fn keep(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        FAULT.get_or_init(|| error);
    }
}
