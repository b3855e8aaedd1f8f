//! `infonerf demo`: one scene in half a minute at most, for a first look.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Args;
use image::{RgbImage, imageops};
use infonerf_experiment::execute::{Executed, Executor, PlanEvent, RunEnd, execute};
use infonerf_experiment::sweep::Sweep;
use infonerf_experiment::{Existing, Experiment, RunEvent, Selection, Session};
use infonerf_metrics::to_rgb8;
use infonerf_render::render_tested;
use infonerf_scene::View;
use infonerf_train::Trainer;

use crate::interrupt;
use crate::print::{errln, outln};
use crate::progress::ProgressDisplay;
use crate::reporter::summary;
use crate::selection::DeviceArgs;
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

/// Shares of the run at which a preview is shown.
const PREVIEWS: [f64; 3] = [0.05, 0.2, 0.5];
/// Longest side of previews, in pixels.
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
    let sweep = Sweep::from(Experiment::plan("fast-losses", &selection)?);
    // A demonstration shows the training: a finished one is no reason not to.
    let session = Session::new(open_device(args.device.device)?, args.out.join("demo"), Existing::Overwrite);
    interrupt::install()?;
    outln!("{}: trained on four views, tested on others (on {})", args.scene, session.device.name);
    let mut progress = ProgressDisplay::new(&args.scene);
    let mut due = PREVIEWS.iter().peekable();
    let mut watch = |event: PlanEvent<'_>| {
        match event {
            PlanEvent::Run(_, _, event) => {
                if let RunEvent::Training { trainer, .. } = &event
                    && is_terminal()
                    && due.next_if(|share| trainer.done() >= **share).is_some()
                {
                    progress.suspend(|| show_or_warn(preview(trainer)));
                }
                progress.show(event);
            }
            PlanEvent::RunEnded(_, plan, RunEnd::Trained(record, trainers)) => {
                if let Some(trainer) = trainers.first().filter(|_| is_terminal()) {
                    outln!("a view that was not trained on: rendered on the left, its truth on the right");
                    show_or_warn(next_to_truth(trainer));
                }
                outln!("{}\nnext: infonerf render {}", summary(&record), session.run_folder(plan).display());
            }
            PlanEvent::Written(_, Some(outcome), _) => outln!("report: {}", outcome.report.display()),
            _ => {}
        }
        interrupt::control()
    };
    match execute(&[sweep], &session.out, &Executor::InProcess(&session), &mut watch)? {
        Executed::Ended { .. } => Ok(ExitCode::SUCCESS),
        _ => {
            outln!("stopped");
            Ok(interrupt::exit_code())
        }
    }
}

fn show_or_warn(picture: Result<RgbImage>) {
    match picture {
        Ok(picture) => show(&picture),
        Err(error) => errln!("warning: no preview: {error}"),
    }
}

/// Returns the first test view as learned so far.
fn preview(trainer: &Trainer) -> Result<RgbImage> {
    let view = first_test_view(trainer)?;
    let factor = view.image.width.max(view.image.height).div_ceil(PREVIEW_SIZE);
    rendered(trainer, &view.reduced(factor))
}

/// Returns the first test view, and its truth to the right of it.
fn next_to_truth(trainer: &Trainer) -> Result<RgbImage> {
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
