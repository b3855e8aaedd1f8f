//! `infonerf tensorboard`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_report::write_tensorboard;

use crate::print::outln;

const TENSORBOARD_EXAMPLES: &str = "\
Examples:
  infonerf tensorboard runs/synthetic-4view && tensorboard --logdir runs/synthetic-4view
      every loss, PSNR and rate of every run of an experiment";

/// Write the training curves of runs as TensorBoard event files.
#[derive(Debug, Args)]
#[command(after_help = TENSORBOARD_EXAMPLES)]
pub(crate) struct TensorboardArgs {
    /// Folder of a run, or one that contains runs
    folder: PathBuf,
}

pub(crate) fn run(args: &TensorboardArgs) -> Result<ExitCode> {
    let written = write_tensorboard(&args.folder)?;
    outln!("{} event files; show them with: tensorboard --logdir {}", written.len(), args.folder.display());
    Ok(ExitCode::SUCCESS)
}
