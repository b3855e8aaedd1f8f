//! `--resume` and `--overwrite`: what happens to existing runs.

use clap::Args;
use infonerf_experiment::Existing;

#[derive(Clone, Debug, Args)]
pub(crate) struct ExistingArgs {
    /// Resume runs that were interrupted, and keep finished ones.
    #[arg(long, conflicts_with = "overwrite")]
    resume: bool,
    /// Replace the results of finished runs.
    #[arg(long)]
    pub(crate) overwrite: bool,
}

impl ExistingArgs {
    pub(crate) fn existing(&self) -> Existing {
        match (self.resume, self.overwrite) {
            (true, _) => Existing::Resume,
            (_, true) => Existing::Overwrite,
            _ => Existing::Refuse,
        }
    }
}
