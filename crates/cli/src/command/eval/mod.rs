//! `infonerf eval`: runs again, or pictures that somebody else rendered.

mod pictures;
mod runs;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::selection::{DeviceArgs, NetworkArgs};
use pictures::PicturesArgs;

const EVAL_EXAMPLES: &str = "\
Examples:
  infonerf eval runs/synthetic-4view/castle/infonerf+/seed0 --test all
      on all 200 test views
  infonerf eval runs/integration/castle/nerf/seed0 runs/integration/castle/mipnerf/seed0 --scale 1/2,1/4,1/8
      compares two runs at smaller image sizes than they were trained at
  infonerf eval --renders their/renders --truth their/test --out compared
      compares PNG or JPEG pictures of equal names: a table, compared/comparison.json and a page with sliders";

/// Evaluate finished runs again, also at smaller image sizes, or pictures rendered by other programs.
#[derive(Debug, Args)]
#[command(after_help = EVAL_EXAMPLES)]
pub(crate) struct EvalArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf+/seed0; several are compared
    #[arg(required_unless_present = "renders", conflicts_with = "renders", value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Test views: all, split, every-8, first-3, 0,8,16, training or a published protocol [default: the run's]
    #[arg(long, value_name = "PROTOCOL")]
    test: Option<String>,
    /// Also render at smaller sizes, such as 1/2,1/4,1/8, against area-averaged test views
    #[arg(long = "scale", value_name = "1/N", value_delimiter = ',', value_parser = runs::parse_scale)]
    scales: Vec<u32>,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    networks: NetworkArgs,
    #[command(flatten)]
    pictures: PicturesArgs,
}

pub(crate) fn run(args: &EvalArgs) -> Result<ExitCode> {
    match &args.pictures.folders() {
        Some((renders, truth)) => pictures::run(args, renders, truth),
        None => runs::run(args),
    }
}
