use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use infonerf_experiment::{RunPlan, Trained};
use infonerf_report::{VIEWER_PAGE, write_atomically};

use crate::args::DeviceArgs;
use crate::terminal::open_device;

pub(crate) const EXPORT_EXAMPLES: &str = "\
Examples:
  infonerf export runs/synthetic-4view/castle/infonerf/seed0 --format html
      one page that shows the scene in any browser with WebGL2; needs nothing else";

#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf/seed0.
    run: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// File to write; by default in RUN, named after the format.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ExportFormat {
    /// A page that shows the field as it is: orbit, depth, normals, training cameras.
    Html,
}

impl ExportFormat {
    fn file_name(self) -> &'static str {
        match self {
            Self::Html => VIEWER_PAGE,
        }
    }
}

pub(crate) fn run(args: &ExportArgs) -> Result<ExitCode> {
    let run = Trained::read(RunPlan::of_run(&args.run)?, &args.run, &open_device(args.device.device)?)?;
    for warning in &run.warnings {
        eprintln!("warning: {warning}");
    }
    let out = args.out.clone().unwrap_or_else(|| args.run.join(args.format.file_name()));
    match args.format {
        ExportFormat::Html => page(&run, &args.run, &out)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn page(run: &Trained, folder: &Path, out: &Path) -> Result<()> {
    let page = infonerf_view::page(run).with_context(|| folder.join("config.toml").display().to_string())?;
    write_atomically(out, page.as_bytes())?;
    println!("{:.2} MB: {}", page.len() as f64 / 1e6, out.display());
    Ok(())
}
