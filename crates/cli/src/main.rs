//! `infonerf`: few-shot neural radiance fields from the command line.

#![warn(clippy::print_stderr)]

mod command;
mod command_line;
mod completion;
mod interrupt;
mod json;
mod launch;
mod live;
mod print;
mod progress;
mod reporter;
mod selection;
mod terminal;
mod units;

use std::process::ExitCode;

use anyhow::bail;
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use clap_complete::CompleteEnv;

use command::Args;
use print::errln;

/// Exit code of errors, which the user can correct.
const USER_ERROR: u8 = 2;

/// Has glibc keep the memory that a step frees for the next step. By default it returns blocks to the system, which clears
/// their pages again when they are next used: up to half of the time of a step.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn keep_freed_memory() {
    /// The largest size that every version of glibc accepts, in bytes.
    const LARGEST: libc::c_int = 32 << 20;
    // SAFETY: no other thread runs yet.
    #[allow(unsafe_code)]
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST);
        libc::mallopt(libc::M_TRIM_THRESHOLD, libc::c_int::MAX);
    }
}

fn main() -> ExitCode {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    keep_freed_memory();
    // Prints completions and exits if a shell asks for them; otherwise returns at once.
    CompleteEnv::with_factory(Args::command).complete();
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => return print_argument_error(&error),
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| "warn".into());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time();
    log.log_internal_errors(false).init();
    let result = args.run().and_then(|code| print::fault().map_or(Ok(code), |fault| bail!("standard output: {fault}")));
    result.unwrap_or_else(|error| {
        errln!("error: {}", one_line(&format!("{error:#}")));
        ExitCode::from(USER_ERROR)
    })
}

/// Prints help, or in one line the fault of the arguments.
fn print_argument_error(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        // Errors of printing help, such as a closed pipe, are ignored.
        let _ = error.print();
    } else {
        let text = error.render().to_string();
        // The usage is cut off, since --help prints it as well.
        let message = text.split("\n\nUsage:").next().unwrap_or_default();
        errln!("{}", one_line(message.split("\n\nFor more information").next().unwrap_or_default()));
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(USER_ERROR))
}

/// Returns `text`, such as an error with its causes, on one line.
fn one_line(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join("; ").replace(":; ", ": ").replace("; [", " [")
}
