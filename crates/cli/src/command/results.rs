use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail, ensure};
use clap::Args;
use infonerf_experiment::sweep;
use infonerf_report::{
    Panel, Record, ReportInput, WRITTEN_BY, counted, panel, results_document, save_png, write_atomically,
    write_tensorboard,
};

use crate::command_line;
use crate::print::{errln, outln, quoted};
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
    check_extension(&args.out, "md")?;
    let is_own = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).contains(WRITTEN_BY);
    let is_free = match fs::metadata(&args.out) {
        Err(error) => error.kind() == ErrorKind::NotFound,
        // A device, such as /dev/full, may have no end.
        Ok(found) => found.is_file() && fs::read(&args.out).is_ok_and(is_own),
    };
    ensure!(is_free, "{}: expected no file, or one that `collect` wrote: --out FILE names another", args.out.display());
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
    type NameOf = fn(&Record) -> &String;
    let options: [(&str, &Vec<String>, NameOf); 2] =
        [("--scene", &args.scenes, |record| &record.scene), ("--variant", &args.variants, |record| &record.variant)];
    let default = args.folder.join("figure.png");
    let out = args.out.as_ref().unwrap_or(&default);
    check_extension(out, "png")?;
    let mut records = sweep::results(&args.folder)?;
    for (option, names, name_of) in options {
        let known: BTreeSet<&str> = records.iter().map(|record| name_of(record).as_str()).collect();
        if let Some(unknown) = names.iter().find(|name| !known.contains(name.as_str())) {
            let known = Vec::from_iter(known).join(", ");
            bail!("{option} {unknown}: expected one of those in {}: {known}", args.folder.display());
        }
    }
    records.retain(|record| options.iter().all(|(_, names, of)| names.is_empty() || names.contains(of(record))));
    let Panel { picture, missing, left_out } = panel(&records, &args.folder, args.view)?;
    let view = args.view.map_or("a test view".to_owned(), |view| format!("test view {view}"));
    missing.iter().for_each(|run| errln!("warning: {run}: no image of {view}"));
    if left_out > 0 {
        let variants = counted(left_out, "variant");
        errln!("warning: the figure leaves out the {variants} with the lowest PSNR; --variant chooses others");
    }
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
    outln!("{}; to show: tensorboard --logdir {}", counted(written.len(), "event file"), quoted(&args.folder));
    Ok(ExitCode::SUCCESS)
}
