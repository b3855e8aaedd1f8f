//! `infonerf exp`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::Args;
use infonerf_experiment::sweep::Sweep;
use infonerf_experiment::{Control, Experiment, Finished, RunEvent, RunPlan, Session, Trained, total_progress};
use infonerf_report::{
    Quantity, Record, VIEWER_PAGE, overview_table, read_records, save_record, write_atomically, write_report,
};
use infonerf_train::{Phase, Trainer};
use serde_json::json;

use crate::existing::ExistingArgs;
use crate::exit::INTERRUPTED;
use crate::launch::{LaunchArgs, drive};
use crate::live::Live;
use crate::output::{Output, Told};
use crate::print::{errln, outln};
use crate::progress::Progress;
use crate::selection::SelectionArgs;
use crate::summary::{print_claims, summary};
use crate::terminal::{fitted, open_device};
use crate::units::parse_time;
use crate::{command_line, interrupt};

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

/// Run an experiment: train every variant on every scene, evaluate on the test views, and write a report.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXP_EXAMPLES)]
pub(crate) struct ExpArgs {
    /// Built-in experiment (see `infonerf list`) or TOML file, such as the config.toml of a run
    experiment: String,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Training time per run, such as 60s or 5m; schedules follow the clock
    #[arg(long, value_name = "TIME", value_parser = parse_time, allow_hyphen_values = true)]
    budget: Option<Duration>,
    /// Folder for results
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
    #[command(flatten)]
    existing: ExistingArgs,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Show the runs in a browser while they train, with pause and stop, on this port of 127.0.0.1 (0: any free one; 7007 if
    /// none is given)
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "7007")]
    view: Option<u16>,
    /// Print where time went and what skipping saved; a GPU is waited for after each phase of a step, which slows it down
    #[arg(long)]
    profile: bool,
    /// Print only warnings and errors
    #[arg(long, conflicts_with = "json")]
    quiet: bool,
    /// Print events as JSON, one per line
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &ExpArgs) -> Result<ExitCode> {
    let experiment = Experiment::plan(&args.experiment, &args.selection.selection(args.budget))?;
    if args.launch.in_process()? {
        return in_process(args, &experiment);
    }
    let own =
        [("--profile", args.profile), ("--view", args.view.is_some()), ("--quiet", args.quiet), ("--json", args.json)];
    if let Some((option, _)) = own.into_iter().find(|(_, given)| *given) {
        match args.launch.limit() {
            Some(limit) => bail!("{option}: expected no {limit}, with which each run is a process of its own"),
            None => bail!("{option}: expected --launch local"),
        }
    }
    let mut sweep = Sweep::of(experiment);
    sweep.overwrites = args.existing.overwrite;
    drive(&[sweep], &args.selection, &args.launch, &args.out, |outcomes| {
        outcomes.iter().for_each(|outcome| print_claims(&outcome.input));
        Ok(())
    })
}

/// Runs an experiment in this process.
fn in_process(args: &ExpArgs, experiment: &Experiment) -> Result<ExitCode> {
    let device = open_device(args.selection.device.device)?;
    let networks = args.selection.networks.open(&device)?;
    let session =
        Session::new(device, &args.out, args.existing.existing()).with_networks(networks).profiled(args.profile);
    let output = match (args.quiet, args.json) {
        (true, _) => Output::Quiet,
        (_, true) => Output::Json,
        _ => Output::Text,
    };
    let folder = session.experiment_folder(&experiment.about.name);
    refuse_unreadable(&folder.join("results.json"))?;
    let live = args.view.map(|port| Live::start(&folder, port, session.device.clone())).transpose()?;
    interrupt::install()?;
    if output == Output::Text {
        announce(experiment, &session);
    }
    if let Some(live) = &live {
        output.say(format_args!("live at {}", live.url()));
        output.tell(&json!({ "event": "live", "url": live.url() }));
    }
    let control = || live.as_ref().map_or_else(interrupt::control, Live::control);
    let mut records: Vec<Record> = Vec::new();
    for (index, plan) in experiment.runs.iter().enumerate() {
        let label = format!("[{}/{}] {}", index + 1, experiment.runs.len(), plan.label());
        match watched(&session, plan, &label, output, &control)? {
            Finished::Record(record, trainers) => {
                output.say(format_args!("{label}: {}", summary(&record)));
                output.tell(&json!({ "event": "record", "run": label, "record": &record }));
                if args.profile && output == Output::Text {
                    print_profile(&trainers);
                }
                if infonerf_view::holds(&plan.config.field) {
                    write_viewer(plan, trainers, &folder)?;
                }
                records = save_record(&folder, &record)?;
            }
            Finished::Kept(record) => {
                output.say(format_args!("{label}: {} (finished before)", summary(&record)));
                output.tell(&json!({ "event": "record", "run": label, "record": &record }));
                records = save_record(&folder, &record)?;
            }
            Finished::Stopped => {
                output.say(format_args!("{label}: saved; {} continues it", args.existing.same_command()));
                output.tell(&json!({ "event": "stopped", "run": label }));
                return Ok(ExitCode::from(INTERRUPTED));
            }
        }
    }
    let records: Vec<Record> =
        records.into_iter().filter(|record| experiment.runs.iter().any(|plan| same(plan, record))).collect();
    if output == Output::Text {
        print_table(&records);
    }
    let input = experiment.about.report_input(records, &experiment.runs.iter().collect::<Vec<_>>())?;
    if output == Output::Text {
        print_claims(&input);
    }
    let files = write_report(&input, &folder)?;
    command_line::save(&folder)?;
    let (report, numbers) = (files.html, folder.join("results.json"));
    output.say(format_args!("\nreport: {}\nnumbers: {}", report.display(), numbers.display()));
    output.tell(&json!({ "event": "finished", "report": report, "numbers": numbers }));
    if let Some(live) = &live {
        live.keep(&folder, output);
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses results that records could not be added to, before anything is trained.
fn refuse_unreadable(results: &Path) -> Result<()> {
    if results.exists() {
        read_records(results).context("records are added to this file: move it away")?;
    }
    Ok(())
}

/// Runs `plan`, and shows its events.
fn watched(
    session: &Session,
    plan: &RunPlan,
    label: &str,
    output: Output,
    control: &dyn Fn() -> Control,
) -> Result<Finished> {
    if output == Output::Text {
        let mut progress = Progress::new(label)?;
        return session.run(plan, &mut |event| {
            progress.watch(event);
            control()
        });
    }
    let mut told = Told::new(label);
    session.run(plan, &mut |event| {
        if let (RunEvent::Warning(warning), Output::Quiet) = (&event, output) {
            errln!("warning: {warning}");
        }
        if let Some(event) = told.event(&event) {
            output.tell(&event);
        }
        control()
    })
}

/// Leaves the page that shows a run's scene beside the run, for the report to open.
fn write_viewer(plan: &RunPlan, trainers: Vec<Trainer>, experiment: &Path) -> Result<()> {
    let run = Trained { plan: plan.clone(), trainers, warnings: Vec::new() };
    match infonerf_view::page(&run, None) {
        Ok(page) => write_atomically(&experiment.join(plan.directory()).join(VIEWER_PAGE), page.as_bytes())?,
        Err(error) => errln!("warning: {}: no page in 3D: {error:#}", plan.label()),
    }
    Ok(())
}

fn same(plan: &RunPlan, record: &Record) -> bool {
    (&plan.scene, &plan.variant, plan.seed, plan.preset.name())
        == (&record.scene, &record.variant, record.seed, record.preset.as_str())
}

fn announce(experiment: &Experiment, session: &Session) {
    let about = &experiment.about;
    outln!("{}: {} ({} runs, on {})", about.name, about.title, experiment.runs.len(), session.device.name);
    match &about.data {
        Some(data) => outln!("scenes from {}", data.display()),
        None => outln!("no --data given: using the built-in procedural scenes"),
    }
    let mut scenes: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for plan in &experiment.runs {
        let listed = scenes.entry(plan.preset.name()).or_default();
        if !listed.contains(&plan.scene.as_str()) {
            listed.push(&plan.scene);
        }
    }
    for (preset, scenes) in scenes {
        outln!("preset {preset}: {}", scenes.join(", "));
    }
}

fn print_table(records: &[Record]) {
    outln!("\n{}", fitted(&overview_table(records, &Quantity::all())));
}

fn print_profile(trainers: &[Trainer]) {
    let progress = total_progress(trainers);
    let steps = progress.step.max(1) as f64;
    let skipped = 1.0 - progress.samples_evaluated as f64 / progress.samples_total.max(1) as f64;
    outln!(
        "    samples: {} of {} evaluated, {:.1} % skipped",
        progress.samples_evaluated,
        progress.samples_total,
        100.0 * skipped
    );
    if progress.pixels_skipped > 0 {
        outln!("    pixels: {} draws rejected as well fitted", progress.pixels_skipped);
    }
    if let [trainer] = trainers {
        outln!("    per step: {}", trainer.profile().traffic().per_step(trainer.progress().step));
    }
    for phase in Phase::ALL {
        let spent = trainers.iter().map(|trainer| trainer.profile().spent(phase).as_secs_f64()).sum::<f64>();
        outln!(
            "    {:12} {:8.2} ms per step {:5.1} %",
            phase.name(),
            spent / steps * 1e3,
            100.0 * spent / progress.seconds
        );
    }
}
