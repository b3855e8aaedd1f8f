use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_metrics::{Folders, METRICS, Protocol, compare_folders, select};
use infonerf_report::PictureComparison;

use crate::args::EvalArgs;
use crate::terminal::open_device;

pub(crate) fn run(args: &EvalArgs, renders: &Path, truth: &Path) -> Result<ExitCode> {
    let protocol = Protocol::named(&args.pictures.protocol).with_context(|| {
        let known = Protocol::NAMED.map(|(name, _)| name).join(", ");
        format!("--protocol {}: expected one of {known}", args.pictures.protocol)
    })?;
    // What was asked for by name has to have a value; without names, all that can be measured is.
    let required = select(args.pictures.metrics.iter().map(String::as_str))?;
    let metrics = if required.is_empty() { METRICS } else { required.as_slice() };
    let networks = args.weights.networks(&open_device(args.device.device)?)?;
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
    print!("{}", comparison.to_text());
    if let Some(out) = &args.pictures.out {
        let files = comparison.write(out)?;
        println!("{}\n{}", files.json.display(), files.html.display());
    }
    Ok(ExitCode::SUCCESS)
}
