//! `--overwrite`: what happens to runs that exist already.

use clap::Args;
use infonerf_experiment::Existing;

#[derive(Clone, Debug, Args)]
pub(crate) struct ExistingArgs {
    /// Start existing runs anew instead of continuing them
    #[arg(long)]
    overwrite: bool,
}

impl ExistingArgs {
    pub(crate) fn existing(&self) -> Existing {
        if self.overwrite { Existing::Overwrite } else { Existing::Continue }
    }

    /// Names the command that continues a run: without `--overwrite`, which would start it anew.
    pub(crate) fn same_command(&self) -> &'static str {
        if self.overwrite { "the same command without --overwrite" } else { "the same command" }
    }
}
