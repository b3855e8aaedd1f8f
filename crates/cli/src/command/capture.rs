use std::fs::create_dir_all;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::Args;
use humantime::format_duration;
use infonerf_dataset::{
    PoseSearch, SceneSource, changed_photographs, from_images, info, max_matched_pairs, video_folder, video_frames,
};
use infonerf_experiment::execute::{Executed, Executor, PlanEvent, RunEnd, execute};
use infonerf_experiment::sweep::Sweep;
use infonerf_experiment::{
    Existing, Experiment, RunEvent, RunPlan, Selection, Session, Trained, check_name, is_finished,
};
use infonerf_report::{Record, VIEWER_PAGE, counted};
use infonerf_scene::image::{is_image_name, list_images};

use crate::print::{errln, outln, quoted};
use crate::progress::ProgressDisplay;
use crate::reporter::summary;
use crate::selection::{DeviceArgs, ExistingArgs, NetworkArgs};
use crate::terminal::open_device;
use crate::units::{parse_folder, parse_time};
use crate::{command_line, completion, interrupt};

use super::{exp, render, scene};

const CAPTURE_EXAMPLES: &str = "\
Examples:
  infonerf capture my-photos
      finds where the photographs in my-photos were taken from, learns the scene for a minute, renders once around it
  infonerf capture my-photos --budget 5m
      goes on to five minutes, if the first command has come to its end
  infonerf capture walk.mp4
      the sharpest frames of a video, taken by the ffmpeg program, instead of photographs

It does what `infonerf scene from-images`, `scene check`, `exp capture --variant infonerf+` and `render` do, one after another.
The same command again continues what was interrupted, and prints the results of what is finished.";

/// Learn a scene from a folder of photographs or a video: find poses if there are none, check, train, render an orbit and a page.
#[derive(Debug, Args)]
#[command(after_help = CAPTURE_EXAMPLES)]
pub(crate) struct CaptureArgs {
    /// Folder of photographs, without poses or with them (COLMAP, transforms.json, LLFF and others), or a video file
    path: PathBuf,
    /// Training time, such as 60s or 5m; the size of the orbit is chosen so that rendering it takes about half as long
    #[arg(long, value_name = "TIME", value_parser = parse_time, default_value = "60s", allow_hyphen_values = true)]
    budget: Duration,
    /// Folder for results
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs")]
    out: PathBuf,
    #[command(flatten)]
    existing: ExistingArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    networks: NetworkArgs,
    /// Set a key of the config, such as scene.size=400; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", add = completion::keys())]
    set: Vec<String>,
}

/// Minimum number of photographs of which every eighth is held out and measured.
const MIN_MEASURED: usize = 10;
/// Maximum number of photographs that are held out and measured.
const MAX_MEASURED: usize = 8;
/// Maximum number of photographs that the report shows if none is held out.
const MAX_SHOWN: usize = 3;
/// Ratio of the training time to the time for rendering the orbit.
const ORBIT_SHARE: f64 = 2.0;
/// Seconds on two cores for reading and checking a photograph, and for testing each of up to [`MAX_RENDERED`] photographs.
const SECONDS_PER_PHOTOGRAPH: [f64; 2] = [0.1, 2.0];
/// Maximum number of photographs that are rendered for tests and for residuals.
const MAX_RENDERED: usize = 30;

pub(crate) fn run(args: &CaptureArgs) -> Result<ExitCode> {
    let device = open_device(args.device.device)?;
    let networks = args.networks.open(&device)?;
    let photographs = photograph_folder(args)?;
    let dir = photographs.canonicalize().with_context(|| photographs.display().to_string())?;
    let session = Session::new(device, &args.out, args.existing.existing()).with_networks(networks);
    let changed = changed_photographs(&dir)?.unwrap_or_default();
    let is_posed = changed.is_empty() && SceneSource::Folder { path: dir.clone() }.is_scene();
    if !is_posed {
        find_poses(args, &photographs, &dir, &changed, &session)?;
    }
    let info = info(&dir)?;
    let count = info.train_views + info.test_views;
    let experiment = plan(args, &dir, count)?;
    let plan = experiment.runs[0].clone();
    let folder = session.run_folder(&plan);
    let mut warnings = Vec::new();
    if args.existing.existing() == Existing::Overwrite || !is_finished(&folder) {
        if is_posed {
            print_stages(args, count, 0);
        }
        warnings = scene::print_warnings(&photographs)?;
    }
    interrupt::install()?;
    let Some((trained, report)) = train(experiment, &session, &warnings, result)? else {
        outln!("stopped and saved; {} continues", args.existing.same_command());
        return Ok(interrupt::exit_code());
    };
    let longer = longer_command(args.budget, &plan);
    let Some(orbit) = write_pictures(trained, (plan, &folder), &session, args.budget)? else {
        outln!("stopped; the scene is learned, and {} renders its orbit", args.existing.same_command());
        return Ok(interrupt::exit_code());
    };
    let page = folder.join(VIEWER_PAGE);
    outln!("report: {}\norbit: {}\npage: {}", report.display(), orbit.display(), page.display());
    let out = quoted(&args.out);
    outln!("next: `infonerf view {out}`{longer}");
    Ok(ExitCode::SUCCESS)
}

/// Returns the advice to train longer than `budget`; none if the run has as many fields as any and their steps are limited.
fn longer_command(budget: Duration, plan: &RunPlan) -> String {
    let ensemble = &plan.config.train.ensemble;
    if ensemble.max_steps > 0 && plan.members() >= ensemble.members(Some(f64::INFINITY)) {
        return String::new();
    }
    let longer = format_duration(budget.saturating_mul(5)).to_string().replace(' ', "");
    format!(", or the same command with --budget {longer} for a better scene")
}

/// Finds the poses of the `photographs`, whose absolute path is `dir`. Refuses, before that, a faulty name or setting, a folder
/// that cannot be written, and an existing run of other photographs or of those that have `changed` since.
fn find_poses(args: &CaptureArgs, photographs: &Path, dir: &Path, changed: &[String], session: &Session) -> Result<()> {
    let count = list_images(&infonerf_dataset::photograph_folder(photographs))?.len();
    let run = plan(args, dir, count)?.runs.remove(0);
    let folder = session.run_folder(&run);
    create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    if args.existing.existing() == Existing::Continue && folder.join("config.toml").exists() {
        let (begun, path, place) = (RunPlan::of_run(&folder)?, args.path.display(), folder.display());
        let is_same = begun.data == run.data;
        let other = begun.data.unwrap_or_default().join(begun.scene);
        ensure!(is_same, "{path}: {place} is of {}; --out names another folder for results", other.display());
        let expected = format!("expected the photographs of {place}: added, changed or removed since");
        let (changes, remedy) = (changed.join(", "), "--overwrite finds the poses again and trains anew");
        ensure!(changed.is_empty(), "{path}: {expected}: {changes}; {remedy}");
    }
    let pairs = max_matched_pairs(count);
    if pairs > 0 {
        print_stages(args, count, pairs);
    }
    from_images(photographs, &PoseSearch::default(), |line| outln!("{line}"))?;
    Ok(())
}

/// Returns the folder of photographs: the given one, or the folder that the frames of the given video are written to.
fn photograph_folder(args: &CaptureArgs) -> Result<PathBuf> {
    let path = &args.path;
    if path.is_dir() {
        return Ok(path.to_owned());
    }
    let expected = format!("{}: expected a folder of photographs or a video file", path.display());
    ensure!(path.is_file(), "{expected}: not found");
    ensure!(!is_image_name(path), "{expected}: it is one photograph; give its folder");
    // Refuses a faulty setting before the video is taken apart, by a plan for any scene.
    Experiment::plan("capture", &selection(args, None, "room", MIN_MEASURED))?;
    let frames = video_folder(path, &args.out);
    video_frames(path, &frames, |line| outln!("{line}"))?;
    Ok(frames)
}

/// Prints the stages for `count` photographs, at most `pairs` pairs of which are matched for poses, with their estimated times.
fn print_stages(args: &CaptureArgs, count: usize, pairs: usize) {
    let time = |seconds: u64| format_duration(Duration::from_secs(seconds));
    let [read, rendered] = SECONDS_PER_PHOTOGRAPH;
    let around = (read * count as f64 + rendered * count.min(MAX_RENDERED) as f64).ceil() as u64;
    let budget = args.budget.as_secs().max(1);
    let orbit = args.budget.div_f64(ORBIT_SHARE).as_secs().max(1);
    // From 0.2 to 1.1 s per pair: docs/photographs.md.
    let (quick, slow) = (pairs as u64 / 5, pairs as u64);
    let poses = if pairs == 0 { "none to find".to_owned() } else { format!("{} to {}", time(quick), time(slow)) };
    let [least, most] = [quick, slow].map(|poses| time(poses + budget + orbit + around).to_string());
    let whole = if least == most { least } else { format!("{least} to {most}") };
    let [budget, around, orbit] = [budget, around, orbit].map(time);
    outln!("{}: {}, about {whole} in all:", args.path.display(), counted(count, "photograph"));
    outln!("  poses            {poses}\n  check            seconds");
    outln!("  training         at most {budget}, and about {around} before and afterwards\n  orbit and page   {orbit}");
}

/// Plans the run on the `count` photographs in `dir`.
fn plan(args: &CaptureArgs, dir: &Path, count: usize) -> Result<Experiment> {
    let (Some(data), Some(name)) = (dir.parent(), dir.file_name().and_then(|name| name.to_str())) else {
        bail!("{}: expected a folder of photographs whose name is text", args.path.display());
    };
    check_name("folder", name).map_err(|fault| anyhow!("{fault}; rename it, since results take its name"))?;
    Experiment::plan("capture", &selection(args, Some(data.to_owned()), name, count))
}

/// Selects the run of `exp capture --variant infonerf+` on a scene, by default a built-in one. Of fewer than
/// [`MIN_MEASURED`] photographs none is held out.
fn selection(args: &CaptureArgs, data: Option<PathBuf>, scene: &str, count: usize) -> Selection {
    let (test, views) = if count < MIN_MEASURED { ("training", MAX_SHOWN) } else { ("split", MAX_MEASURED) };
    let test = [format!("eval.test={test}"), format!("eval.max_views={views}")];
    Selection {
        data,
        scenes: vec![scene.to_owned()],
        variants: vec!["infonerf+".into()],
        set: test.into_iter().chain(args.set.iter().cloned()).collect(),
        budget: Some(args.budget.as_secs_f64()),
        ..Selection::default()
    }
}

/// Trains the one run of `experiment`, prints its `result` and writes its page, unless it is finished; then writes the report.
/// Returns the fields, if they were trained just now, and the report's path; `None` if the user stops. `known` warnings are not
/// repeated.
pub(super) fn train(
    experiment: Experiment,
    session: &Session,
    known: &[String],
    result: fn(&Record) -> String,
) -> Result<Option<(Option<Trained>, PathBuf)>> {
    let folder = session.out.join(&experiment.about.name);
    let mut progress = ProgressDisplay::new(&experiment.runs[0].label());
    let mut trained = None;
    let mut watch = |event: PlanEvent<'_>| {
        match event {
            PlanEvent::Started(_, prepared) => {
                prepared.warning.iter().for_each(|warning| errln!("warning: {warning}"));
            }
            PlanEvent::Run(_, _, RunEvent::Warning(doubt)) if known.iter().any(|known| doubt.ends_with(known)) => {}
            PlanEvent::Run(_, _, event) => progress.show(event),
            PlanEvent::RunEnded(sweep, index, RunEnd::Trained(record, fields)) => {
                outln!("{}", result(&record));
                if let Err(error) = exp::write_viewer(&fields, &session.run_folder(sweep.run(index))) {
                    errln!("warning: no page in 3D: {error:#}");
                }
                trained = Some(*fields);
            }
            PlanEvent::RunEnded(_, _, RunEnd::AlreadyDone(record)) => outln!("{} (finished before)", result(&record)),
            _ => {}
        }
        interrupt::control()
    };
    let executed = execute(&[Sweep::from(experiment)], &session.out, &Executor::InProcess(session), &mut watch)?;
    let Executed::Ended { outcomes, .. } = executed else { return Ok(None) };
    command_line::save_or_warn(&folder);
    let outcome = outcomes.into_iter().next().context("the run has left no record")?;
    Ok(Some((trained, outcome.report)))
}

/// Describes the result of a run: metrics on held-out photographs if there are any, otherwise steps and time.
fn result(record: &Record) -> String {
    if record.test_views.protocol == "training" {
        let (steps, seconds) = (counted(record.iterations as usize, "step"), record.train_seconds);
        return format!("{steps} in {seconds:.1} s; no photograph is held out, so no figure is measured");
    }
    let held_out = counted(record.test_views.count, "held-out photograph");
    format!("{}, measured on {held_out}", summary(record))
}

/// Writes orbit and page of the run of `plan` in `folder`, unless they are there and the fields were not `trained` just now.
/// Returns the path of the orbit; `None` if the user stops the rendering.
fn write_pictures(
    trained: Option<Trained>,
    (plan, folder): (RunPlan, &Path),
    session: &Session,
    budget: Duration,
) -> Result<Option<PathBuf>> {
    let (orbit, page) = (folder.join("render/orbit.gif"), folder.join(VIEWER_PAGE));
    if trained.is_none() && orbit.is_file() && page.is_file() {
        return Ok(Some(orbit));
    }
    let trained = trained.map_or_else(|| Trained::read(plan, folder, &session.device), Ok)?;
    if !page.is_file() {
        exp::write_viewer(&trained, folder)?;
    }
    render::write_orbit(&trained, &folder.join("render"), budget.div_f64(ORBIT_SHARE))
}
