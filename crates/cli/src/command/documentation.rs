//! `infonerf completions` and `infonerf man`: the command line for shells and for `man`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Args, Command};
use clap_complete::Shell;

use crate::print::{self, outln};

/// Print shell completions: `infonerf completions bash > /etc/bash_completion.d/infonerf`.
#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

/// Write the manual pages, one per subcommand.
#[derive(Debug, Args)]
pub(crate) struct ManArgs {
    /// Folder for the pages, such as /usr/local/share/man/man1
    #[arg(long, value_name = "DIR", default_value = "man")]
    out: PathBuf,
}

/// Prints the completions of a shell for `command`.
pub(crate) fn completions(args: &CompletionsArgs, command: &mut Command) -> Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, command, "infonerf", &mut script);
    print::out(format_args!("{}", String::from_utf8(script)?));
    Ok(ExitCode::SUCCESS)
}

/// Writes `infonerf.1` and a page for each subcommand of `command`.
pub(crate) fn man(args: &ManArgs, command: Command) -> Result<ExitCode> {
    let named = || args.out.display().to_string();
    std::fs::create_dir_all(&args.out).with_context(named)?;
    clap_mangen::generate_to(command, &args.out).with_context(named)?;
    outln!("manual pages: {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
