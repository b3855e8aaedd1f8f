//! `infonerf eval`: runs again, or pictures that somebody else rendered.

mod pictures;
mod runs;

use std::process::ExitCode;

use anyhow::Result;

use crate::args::EvalArgs;

pub(crate) fn run(args: &EvalArgs) -> Result<ExitCode> {
    match &args.pictures.folders() {
        Some((renders, truth)) => pictures::run(args, renders, truth),
        None => runs::run(args),
    }
}
