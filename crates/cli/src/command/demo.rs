//! `infonerf demo`: one scene in half a minute at most, for a first look.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Args;
use image::{RgbImage, imageops};
use infonerf_experiment::{Existing, Experiment, Finished, RunEvent, Selection, Session};
use infonerf_metrics::to_rgb8;
use infonerf_render::render_tested;
use infonerf_report::{save_record, write_report};
use infonerf_scene::View;
use infonerf_train::Trainer;

use crate::exit::INTERRUPTED;
use crate::interrupt;
use crate::print::{errln, outln};
use crate::progress::Progress;
use crate::selection::DeviceArgs;
use crate::summary::summary;
use crate::terminal::{is_terminal, open_device, show};

const DEMO_EXAMPLES: &str = "\
Examples:
  infonerf demo
      the crane, from four views
  infonerf demo --scene castle --device wgpu
      another scene, on a GPU";

/// Train on four views of a built-in scene in ten to thirty seconds, and watch it appear.
#[derive(Clone, Debug, Args)]
#[command(after_help = DEMO_EXAMPLES)]
pub(crate) struct DemoArgs {
    /// Built-in scene (see `infonerf scene list`)
    #[arg(long, default_value = "crane")]
    scene: String,
    #[command(flatten)]
    device: DeviceArgs,
    /// Folder for results
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

/// Shares of the run at which a picture is shown.
const PREVIEWS: [f64; 3] = [0.05, 0.2, 0.5];
/// Longest side of these pictures, in pixels.
const PREVIEW_SIZE: u32 = 64;
/// Test views that are measured: a few all round, enough for a first look.
const TEST_VIEWS: &str = "eval.test=every-40";

pub(crate) fn run(args: &DemoArgs) -> Result<ExitCode> {
    let selection = Selection {
        scenes: vec![args.scene.clone()],
        variants: vec!["infonerf+".into()],
        set: vec![TEST_VIEWS.into()],
        ..Selection::default()
    };
    let experiment = Experiment::plan("fast-losses", &selection)?;
    let plan = experiment.runs.first().context("expected a run of fast-losses")?;
    let session = Session::new(open_device(args.device.device)?, args.out.join("demo"), Existing::Overwrite);
    interrupt::install()?;
    outln!("{}: trained on four views, tested on others (on {})", args.scene, session.device.name);
    let mut progress = Progress::new(&args.scene)?;
    let mut due = PREVIEWS.iter().peekable();
    let finished = session.run(plan, &mut |event| {
        if let RunEvent::Training { trainer, .. } = &event
            && is_terminal()
            && due.next_if(|share| trainer.done() >= **share).is_some()
        {
            match preview(trainer) {
                Ok(picture) => progress.suspend(|| show(&picture)),
                Err(error) => progress.suspend(|| errln!("warning: no preview: {error}")),
            }
        }
        progress.watch(event)
    })?;
    let Finished::Record(record, trainers) = finished else {
        outln!("stopped");
        return Ok(ExitCode::from(INTERRUPTED));
    };
    let folder = session.experiment_folder(&experiment.about.name);
    let records = save_record(&folder, &record)?;
    let input = experiment.about.report_input(records, &[plan])?;
    let files = write_report(&input, &folder)?;
    if is_terminal()
        && let Some(trainer) = trainers.first()
    {
        outln!("a view that was not trained on: rendered on the left, its truth on the right");
        show(&beside_truth(trainer)?);
    }
    outln!("{}\nreport: {}", summary(&record), files.html.display());
    outln!("next: infonerf render {}", folder.join(plan.directory()).display());
    Ok(ExitCode::SUCCESS)
}

/// The first test view as learned so far.
fn preview(trainer: &Trainer) -> Result<RgbImage> {
    let view = first_test_view(trainer)?;
    let factor = view.image.width.max(view.image.height).div_ceil(PREVIEW_SIZE);
    rendered(trainer, &view.reduced(factor))
}

/// The first test view, and its truth to the right of it.
fn beside_truth(trainer: &Trainer) -> Result<RgbImage> {
    let view = first_test_view(trainer)?;
    let (width, height) = (view.image.width, view.image.height);
    let mut both = RgbImage::new(2 * width, height);
    imageops::replace(&mut both, &rendered(trainer, view)?, 0, 0);
    imageops::replace(&mut both, &to_rgb8(&view.image.rgb, width, height)?, i64::from(width), 0);
    Ok(both)
}

fn first_test_view(trainer: &Trainer) -> Result<&View> {
    trainer.scene().test.first().context("expected a test view")
}

fn rendered(trainer: &Trainer, view: &View) -> Result<RgbImage> {
    let image = render_tested(trainer.renderer(), &[trainer.trained_with_residuals()], view);
    Ok(to_rgb8(&image.rgb, image.width, image.height)?)
}
