use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use infonerf_experiment::execute::{Executed, Executor, PlanEvent, RunEnd, execute};
use infonerf_experiment::sweep::Sweep;
use infonerf_experiment::{Experiment, RunEvent, Session, Trained};
use infonerf_report::{VIEWER_PAGE, write_atomically};
use serde_json::json;

use crate::json::JsonEvents;
use crate::launch::{LaunchArgs, OWN_PROCESSES};
use crate::live::Live;
use crate::print::{errln, outln};
use crate::reporter::Reporter;
use crate::selection::SelectionArgs;
use crate::terminal::open_device;
use crate::units::{parse_folder, parse_time};
use crate::{command_line, completion, interrupt};

const EXP_EXAMPLES: &str = "\
Examples:
  infonerf exp synthetic-4view
      NeRF and InfoNeRF on the built-in scenes, four views each; needs no data
  infonerf exp synthetic-4view --data nerf_synthetic --seed 0..4
      the same on real Blender data: reads nerf_synthetic/lego/transforms_train.json
  infonerf exp synthetic-4view --data nerf_synthetic --scene lego --variant infonerf --budget 60s
      one variant, one minute
  infonerf exp runs/synthetic-4view/lego/infonerf/seed0/config.toml
      repeats a run, with the same numbers";

const CAPTURE_WITHOUT_DATA: &str = "\
capture: expected photographs: `infonerf capture my-photos` learns from a folder of them, or name a folder with poses: `infonerf exp \
capture --data . --scene my-photos` (or a built-in scene: --scene room)";

/// Run an experiment: train every variant on every scene, evaluate on the test views, and write a report.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXP_EXAMPLES)]
pub(crate) struct ExpArgs {
    /// Built-in experiment (see `infonerf list`) or TOML file, such as the config.toml of a run
    #[arg(add = completion::experiments())]
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Training time per run, such as 60s or 5m; schedules follow the clock
    #[arg(long, value_name = "TIME", value_parser = parse_time, allow_hyphen_values = true)]
    budget: Option<Duration>,
    /// Folder for results
    #[arg(long, value_name = "DIR", value_parser = parse_folder, default_value = "runs")]
    out: PathBuf,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Show the runs in a browser while they train, with pause and stop, on this port of 127.0.0.1 (0: any free one; 7007 if
    /// none is given)
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "7007")]
    #[arg(conflicts_with_all = OWN_PROCESSES)]
    view: Option<u16>,
    /// Print only warnings and errors
    #[arg(long, conflicts_with = "json", conflicts_with_all = OWN_PROCESSES)]
    quiet: bool,
    /// Print events as JSON, one per line
    #[arg(long, conflicts_with_all = OWN_PROCESSES)]
    json: bool,
}

pub(crate) fn run(args: &ExpArgs) -> Result<ExitCode> {
    let experiment = Experiment::plan(&args.experiment, &args.selection.selection(args.budget))?;
    if experiment.about.name == "capture" && args.selection.data.is_none() && args.selection.scenes.is_empty() {
        bail!("{CAPTURE_WITHOUT_DATA}");
    }
    let sweep = Sweep::from(experiment);
    if args.launch.own_processes()? {
        return args.launch.run(vec![sweep], &args.selection, &args.out, |_| Ok(()));
    }
    in_process(args, &sweep)
}

fn in_process(args: &ExpArgs, sweep: &Sweep) -> Result<ExitCode> {
    let existing = &args.launch.existing;
    let device = open_device(args.selection.device.device)?;
    let networks = args.selection.networks.open(&device)?;
    let session = Session::new(device, &args.out, existing.existing()).with_networks(networks);
    let folder = sweep.folder(&args.out);
    let live = args.view.map(|port| Live::start(&folder, port, session.device.clone())).transpose()?;
    interrupt::install()?;
    let (as_text, as_json) = (!args.quiet && !args.json, args.json);
    match &live {
        Some(live) if as_json => outln!("{}", json!({ "event": "live", "url": live.url() })),
        Some(live) if as_text => outln!("live at {}", live.url()),
        _ => {}
    }
    let (mut reporter, mut events) =
        (Reporter::new(existing.same_command(), session.device.name, true, &args.out), JsonEvents::default());
    let mut watch = |event: PlanEvent<'_>| {
        match &event {
            PlanEvent::Written(_, Some(_), _) if !as_text => command_line::save_or_warn(&folder),
            PlanEvent::Run(_, _, RunEvent::Warning(warning)) if args.quiet => errln!("warning: {warning}"),
            PlanEvent::RunEnded(sweep, index, RunEnd::Failed(reason)) if !as_text => {
                errln!("{}: failed: {reason}", sweep.run(*index).label());
            }
            PlanEvent::RunEnded(sweep, index, RunEnd::Trained(_, trained)) => {
                let plan = sweep.run(*index);
                if infonerf_view::is_exact(&plan.config.field)
                    && let Err(error) = write_viewer(trained, &folder.join(plan.directory()))
                {
                    errln!("warning: {}: no page in 3D: {error:#}", plan.label());
                }
            }
            _ => {}
        }
        if as_json && let Some(event) = events.event(&event) {
            outln!("{event}");
        }
        if as_text {
            reporter.watch(event);
        }
        live.as_ref().map_or_else(interrupt::control, Live::control)
    };
    let executed = execute(std::slice::from_ref(sweep), &args.out, &Executor::InProcess(&session), &mut watch)?;
    let Executed::Ended { unfinished, .. } = executed else { return Ok(interrupt::exit_code()) };
    if let Some(live) = &live {
        live.serve_after_training(&folder, as_text);
    }
    Ok(if unfinished > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Writes the page that shows a run's scene to the run's `folder`, where the report links to it.
pub(crate) fn write_viewer(trained: &Trained, folder: &Path) -> Result<()> {
    let page = infonerf_view::page(trained, folder, None)?;
    Ok(write_atomically(&folder.join(VIEWER_PAGE), page.as_bytes())?)
}
