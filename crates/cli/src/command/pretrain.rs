use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::{Experiment, RunEvent, Session, pretrain};
use infonerf_report::counted;
use infonerf_train::Event;

use crate::print::outln;
use crate::progress::ProgressDisplay;
use crate::selection::{ExistingArgs, SelectionArgs};
use crate::terminal::open_device;
use crate::units::parse_folder;
use crate::{completion, interrupt};

const PRETRAIN_EXAMPLES: &str = "\
Examples:
  infonerf pretrain pixelnerf-pretrain
      PixelNeRF on procedural scenes drawn at random; leaves runs/pixelnerf-pretrain
  infonerf pretrain pixelnerf-pretrain --data nerf_synthetic
      the same on all scenes in a folder
  infonerf exp integration-pixelnerf --set train.init=runs/pixelnerf-pretrain
      fine-tunes the result on a few views of another scene";

/// Pre-train one model on all scenes of an experiment, to initialise other runs (`train.init`).
#[derive(Clone, Debug, Args)]
#[command(after_help = PRETRAIN_EXAMPLES)]
pub(crate) struct PretrainArgs {
    /// Built-in experiment (see `infonerf list`) or TOML file with one variant, one seed and the scenes to learn from
    #[arg(add = completion::experiments())]
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Folder for results; the weights go to a subfolder named after the experiment
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs")]
    out: PathBuf,
    #[command(flatten)]
    existing: ExistingArgs,
}

/// Number of last steps over which PSNR is averaged.
const LAST: usize = 100;

pub(crate) fn run(args: &PretrainArgs) -> Result<ExitCode> {
    let experiment = Experiment::plan(&args.experiment, &args.selection.selection(None))?;
    let session = Session::new(open_device(args.selection.device.device)?, &args.out, args.existing.existing());
    interrupt::install()?;
    let (about, scenes) = (&experiment.about, counted(experiment.runs.len(), "scene"));
    let mut progress = ProgressDisplay::new("pre-training");
    let mut psnrs = Vec::new();
    let pretrained = pretrain(&session, &experiment, &mut |event| {
        match &event {
            RunEvent::Loading => outln!("{}: {} ({scenes}) on {}", about.name, about.title, session.device.name),
            RunEvent::Training { event: Event::Step { psnr, .. }, .. } => psnrs.push(*psnr),
            _ => {}
        }
        progress.watch(event)
    })?;
    if !pretrained.finished {
        outln!("{}: saved; {} continues it", about.name, args.existing.same_command());
        return Ok(interrupt::exit_code());
    }
    let last = &psnrs[psnrs.len().saturating_sub(LAST)..];
    let mean = last.iter().sum::<f32>() / last.len() as f32;
    let psnr = match last.len() {
        0 => String::new(),
        count => format!(", PSNR {mean:.2} dB over the rays of the last {}", counted(count, "step")),
    };
    outln!("{} steps in {:.1} s{psnr}", pretrained.progress.step, pretrained.progress.seconds);
    outln!("to start from it: --set train.init={}", pretrained.folder.display());
    Ok(ExitCode::SUCCESS)
}
