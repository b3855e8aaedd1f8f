//! `infonerf figure`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::{read_records, save_png};
use infonerf_report::panel;

use crate::print::outln;

const FIGURE_EXAMPLES: &str = "\
Examples:
  infonerf figure runs/synthetic-4view
      runs/synthetic-4view/figure.png: truth, then render and depth of each variant, a row per scene
  infonerf figure runs/synthetic-4view --view 64 --variant nerf --variant infonerf --out figure.png
      two variants from one test view";

/// Put the truth, renders and depths of runs side by side, as papers do.
#[derive(Debug, Args)]
#[command(after_help = FIGURE_EXAMPLES)]
pub(crate) struct FigureArgs {
    /// Folder of an experiment, such as runs/synthetic-4view.
    #[arg(value_name = "RESULTS")]
    folder: PathBuf,
    /// Id of the test view; by default one from the middle.
    #[arg(long, value_name = "N")]
    view: Option<usize>,
    /// Scenes to show; by default all.
    #[arg(long = "scene", value_name = "NAME")]
    scenes: Vec<String>,
    /// Variants to show; by default all.
    #[arg(long = "variant", value_name = "NAME")]
    variants: Vec<String>,
    /// File to write; by default figure.png in the folder.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &FigureArgs) -> Result<ExitCode> {
    let chosen = |names: &[String], name: &String| names.is_empty() || names.contains(name);
    let mut records = read_records(&args.folder.join("results.json"))?;
    records.retain(|record| chosen(&args.scenes, &record.scene) && chosen(&args.variants, &record.variant));
    let figure = panel(&records, &args.folder, args.view)?;
    let out = args.out.clone().unwrap_or_else(|| args.folder.join("figure.png"));
    save_png(&figure, &out)?;
    outln!("figure: {}", out.display());
    Ok(ExitCode::SUCCESS)
}
