//! Pictures of other programs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_metrics::{Folders, METRICS, Protocol, compare_folders, select};
use infonerf_report::PictureComparison;

use super::EvalArgs;
use crate::print::outln;
use crate::terminal::open_device;

/// Pictures rendered by other programs.
#[derive(Debug, Args)]
#[command(next_help_heading = "Pictures of other programs")]
pub(super) struct PicturesArgs {
    /// Folder of rendered pictures, PNG or JPEG
    #[arg(long, value_name = "DIR", requires = "truth", conflicts_with_all = ["test", "scales"])]
    renders: Option<PathBuf>,
    /// Folder of photographs, named like the renders except for the extension
    #[arg(long, value_name = "DIR", requires = "renders")]
    truth: Option<PathBuf>,
    /// Folder of masks for the masked metrics; black pixels are ignored
    #[arg(long, value_name = "DIR", requires = "renders")]
    masks: Option<PathBuf>,
    /// How pictures are measured: infonerf, regnerf or neural-body (see docs/protocol.md)
    #[arg(long, value_name = "NAME", requires = "renders", default_value = "infonerf")]
    protocol: String,
    /// Key of a metric to compute, such as lpips_vgg; it is an error if it cannot be; may be repeated [default: all that can
    /// be computed]
    #[arg(long = "metric", value_name = "KEY", requires = "renders")]
    metrics: Vec<String>,
    /// Leave out photographs without a render instead of refusing them
    #[arg(long, requires = "renders")]
    partial: bool,
    /// Folder for comparison.json and comparison.html
    #[arg(long, value_name = "DIR", requires = "renders")]
    out: Option<PathBuf>,
}

impl PicturesArgs {
    /// Renders and truth, if they are given.
    pub(super) fn folders(&self) -> Option<(PathBuf, PathBuf)> {
        self.renders.clone().zip(self.truth.clone())
    }
}

pub(super) fn run(args: &EvalArgs, renders: &Path, truth: &Path) -> Result<ExitCode> {
    let protocol = Protocol::named(&args.pictures.protocol).with_context(|| {
        let known = Protocol::NAMED.map(|(name, _)| name).join(", ");
        format!("--protocol {}: expected one of {known}", args.pictures.protocol)
    })?;
    // What was asked for by name has to have a value; without names, all that can be measured is.
    let required = select(args.pictures.metrics.iter().map(String::as_str))?;
    let metrics = if required.is_empty() { METRICS } else { required.as_slice() };
    let networks = args.networks.open(&open_device(args.device.device)?)?;
    let folders = Folders { renders, truth, masks: args.pictures.masks.as_deref(), partial: args.pictures.partial };
    let bar = ProgressBar::new(0);
    bar.set_style(ProgressStyle::with_template("{wide_bar} {pos}/{len} {elapsed}")?);
    let compared = compare_folders(folders, metrics, &networks, &protocol, |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let compared = compared?;
    compared.measured.require(&required)?;
    let title = format!("{} against {}", renders.display(), truth.display());
    let comparison = PictureComparison { title: &title, protocol: &protocol, compared: &compared };
    outln!("{}", comparison.to_text().trim_end());
    if let Some(out) = &args.pictures.out {
        for file in comparison.write(out)? {
            outln!("{}", file.display());
        }
    }
    Ok(ExitCode::SUCCESS)
}
