use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_experiment::{Existing, Experiment, Selection, Session};
use infonerf_report::VIEWER_PAGE;
use infonerf_scene::SceneError;

use super::capture;
use crate::print::outln;
use crate::reporter::summary;
use crate::selection::DeviceArgs;
use crate::terminal::open_device;
use crate::units::parse_folder;
use crate::{completion, interrupt};

const DEMO_EXAMPLES: &str = "\
Examples:
  infonerf demo
      the crane, from four views
  infonerf demo --scene castle --device wgpu
      another scene, on a GPU, by a program built with --features wgpu";

/// Train on four views of a built-in scene in ten to thirty seconds.
#[derive(Clone, Debug, Args)]
#[command(after_help = DEMO_EXAMPLES)]
pub(crate) struct DemoArgs {
    /// Built-in scene (see `infonerf scene list`)
    #[arg(long, default_value = "crane", value_parser = built_in_scene, add = completion::scenes())]
    scene: String,
    #[command(flatten)]
    device: DeviceArgs,
    /// Folder for results
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs")]
    out: PathBuf,
}

/// Test views that are measured: a few all round, enough for a first look.
const TEST_VIEWS: &str = "eval.test=every-40";

fn built_in_scene(name: &str) -> Result<String, SceneError> {
    infonerf_procedural::check_name(name).map(|()| name.to_owned())
}

pub(crate) fn run(args: &DemoArgs) -> Result<ExitCode> {
    let selection = Selection {
        scenes: vec![args.scene.clone()],
        variants: vec!["infonerf+".into()],
        set: vec![TEST_VIEWS.into()],
        ..Selection::default()
    };
    let experiment = Experiment::plan("fast-losses", &selection)?;
    // A demonstration shows training, so a finished run is trained again.
    let session = Session::new(open_device(args.device.device)?, args.out.join("demo"), Existing::Overwrite);
    interrupt::install()?;
    outln!("{}: trained on four views, tested on others (on {})", args.scene, session.device.name);
    let page = session.run_folder(&experiment.runs[0]).join(VIEWER_PAGE);
    if let Some((_, report)) = capture::train(experiment, &session, &[], summary)? {
        if page.is_file() {
            outln!("page in 3D: {}", page.display());
        }
        outln!("report: {}\nnext: infonerf capture FOLDER learns photographs of your own", report.display());
        return Ok(ExitCode::SUCCESS);
    }
    outln!("stopped; the same command begins anew");
    Ok(interrupt::exit_code())
}
