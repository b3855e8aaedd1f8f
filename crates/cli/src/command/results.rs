//! `infonerf collect`, `figure` and `tensorboard`: documents, pictures and curves of finished runs.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::Args;
use infonerf_experiment::{read_records, sweep};
use infonerf_report::{
    ReportInput, WRITTEN_BY, counted, panel, results_document, save_png, write_atomically, write_tensorboard,
};

use crate::command_line;
use crate::print::outln;
use crate::units::check_extension;

/// Collect the results of experiments and sweeps in one Markdown document.
#[derive(Debug, Args)]
pub(crate) struct CollectArgs {
    /// Folder of an experiment or a sweep, such as runs/synthetic-4view
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Title of the document
    #[arg(long, default_value = "Results")]
    title: String,
    /// File to write
    #[arg(long, value_name = "FILE", default_value = "results.md")]
    out: PathBuf,
}

pub(crate) fn collect(args: &CollectArgs) -> Result<ExitCode> {
    let read = |folder: &PathBuf| Ok(ReportInput { command: command_line::read(folder), ..sweep::collect(folder)? });
    if fs::read_to_string(&args.out).is_ok_and(|text| !text.contains(WRITTEN_BY)) {
        bail!("{}: expected no file, or one that `collect` wrote: --out FILE names another", args.out.display());
    }
    let experiments = args.folders.iter().map(read).collect::<Result<Vec<_>>>()?;
    write_atomically(&args.out, results_document(&args.title, &experiments).as_bytes())?;
    outln!("{}: {}", counted(experiments.len(), "experiment"), args.out.display());
    Ok(ExitCode::SUCCESS)
}

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

pub(crate) fn figure(args: &FigureArgs) -> Result<ExitCode> {
    let chosen = |names: &[String], name: &String| names.is_empty() || names.contains(name);
    let (results, default) = (args.folder.join("results.json"), args.folder.join("figure.png"));
    let out = args.out.as_ref().unwrap_or(&default);
    check_extension(out, &default)?;
    let mut records = read_records(&results)?;
    let scenes: BTreeSet<&str> = records.iter().map(|record| &*record.scene).collect();
    let variants: BTreeSet<&str> = records.iter().map(|record| &*record.variant).collect();
    for (option, names, known) in [("--scene", &args.scenes, scenes), ("--variant", &args.variants, variants)] {
        if let Some(unknown) = names.iter().find(|name| !known.contains(name.as_str())) {
            let known = Vec::from_iter(known).join(", ");
            bail!("{option} {unknown}: expected one of those in {}: {known}", results.display());
        }
    }
    records.retain(|record| chosen(&args.scenes, &record.scene) && chosen(&args.variants, &record.variant));
    let picture = panel(&records, &args.folder, args.view)?;
    save_png(&picture, out)?;
    outln!("figure: {}", out.display());
    Ok(ExitCode::SUCCESS)
}

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

pub(crate) fn tensorboard(args: &TensorboardArgs) -> Result<ExitCode> {
    let written = write_tensorboard(&args.folder)?;
    outln!("{} event files; show them with: tensorboard --logdir {}", written.len(), args.folder.display());
    Ok(ExitCode::SUCCESS)
}
