//! `infonerf sweep` and `infonerf sweep-item`.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::launch::{Ended, PEAK_MEMORY, STOPPED, Workers};
use infonerf_experiment::sweep::{
    Execution, Merged, Outcome, PAPER_SPACE, Prepared, State, Sweep, SweepEvent, SweepOptions,
    run_item as run_manifest_item,
};
use infonerf_experiment::{DeviceName, Finished, RunEvent};

use super::INTERRUPTED;
use super::exp::summary;
use super::launch::{LaunchArgs, Mode, print};
use crate::args::{DeviceArgs, SelectionArgs, WeightsArgs, parse_duration};
use crate::interrupt;
use crate::progress::Progress;
use crate::terminal::{emphasis, open_device};

/// Exit code when an item failed.
pub(super) const FAILED: u8 = 1;
/// Of runs that are not finished, so many are named.
const MOST_NAMED: usize = 8;

pub(crate) const SWEEP_EXAMPLES: &str = "\
Examples:
  infonerf sweep synthetic-4view --variant infonerf --grid loss.entropy.weight=0,1e-4,1e-3,1e-2
      one run for each weight and scene
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --grid loss.kl.weight=0,1e-5 --seed 0..4 --jobs 2
      every combination with five seeds, two runs at a time
  infonerf sweep paper-regime --variant infonerf --space paper --seed 0..4
      λ1 × λ2 as a heat map, and whether the best pair is better than its neighbours
  infonerf sweep loss-ablation --variant both --random 20 --range loss.entropy.weight=log:1e-5:1e-1 --halving 3
      twenty random weights; the two thirds that fit the training images worst are stopped early, twice
  infonerf sweep synthetic-4view --grid loss.entropy.weight=0,1e-3 --seed 0..4 --launch slurm --timeout 30m --watch
      each run as a task of a Slurm array; a run that 30 minutes do not suffice for saves, and goes on the next time
The same command again goes on where it was interrupted.";

#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// A built-in experiment (see `infonerf list`) or a TOML file.
    experiment: String,
    /// A key of the config and the values that it takes; again for every combination with another key's.
    #[arg(long = "grid", value_name = "KEY=V1,V2,...", required_unless_present_any = ["random", "space"])]
    grids: Vec<String>,
    /// Ready grids: `paper` has four values of each of λ1 and λ2.
    #[arg(long, value_name = "NAME")]
    space: Option<ReadySpace>,
    /// Random settings of the keys of --range: always the same ones, and more of them for a larger N.
    #[arg(long, value_name = "N", requires = "ranges", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    random: Option<u32>,
    /// A key of the config and where --random draws it from: evenly, evenly in its logarithm, or whole numbers.
    #[arg(long = "range", value_name = "KEY=[log:|int:]LOW:HIGH", requires = "random")]
    ranges: Vec<String>,
    /// Other random settings [default: 0]
    #[arg(long, value_name = "N", requires = "random")]
    random_seed: Option<u64>,
    /// Stop hopeless settings early (successive halving): at 1/N² and 1/N of each run, for instance, only the 1/N of
    /// the settings go on that fit the training images best. Test views have no part in it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=16))]
    halving: Option<u32>,
    #[command(flatten)]
    selection: SelectionArgs,
    /// Training time for each run, such as 60s or 5m; the schedule follows the clock.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    budget: Option<Duration>,
    #[command(flatten)]
    launch: LaunchArgs,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

/// Grids under a name.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ReadySpace {
    /// The paper's two weights.
    Paper,
}

impl ReadySpace {
    fn grids(self) -> Vec<String> {
        match self {
            Self::Paper => PAPER_SPACE.map(str::to_owned).to_vec(),
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct SweepItemArgs {
    /// The manifest.jsonl of a sweep; results go into its folder.
    manifest: PathBuf,
    /// Which of its items, from 0.
    item: usize,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    weights: WeightsArgs,
    /// Stop after this share of the run, such as 0.25, saved to go on later.
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    until: Option<f64>,
    /// Give up after this time, such as 10m; what was saved stays.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    timeout: Option<Duration>,
    /// End when standard input is closed, as it is when the parent process ends.
    #[arg(long, hide = true)]
    tied: bool,
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share = text.parse::<f64>().ok().filter(|share| *share > 0.0 && *share < 1.0);
    share.ok_or_else(|| format!("expected a number above 0 and below 1, found `{text}`"))
}

pub(crate) fn run(args: &SweepArgs) -> Result<ExitCode> {
    let options = SweepOptions {
        grids: [args.space.map(ReadySpace::grids).unwrap_or_default(), args.grids.clone()].concat(),
        random: args.random.unwrap_or(0),
        ranges: args.ranges.clone(),
        random_seed: args.random_seed.unwrap_or(0),
        halving: args.halving,
        selection: args.selection.selection(args.budget),
    };
    let sweep = Sweep::plan(&args.experiment, &options)?;
    let device = args.selection.device.device.built_in()?;
    let merge = || merge(&sweep, &args.out, device);
    match args.launch.mode(device, &args.selection.weights)? {
        Mode::Merge => merge(),
        Mode::Submit(..) | Mode::Print(_) if args.halving.is_some() => {
            bail!("--halving: it is decided on the way which runs go on: expected --launch local")
        }
        Mode::Print(runner) => print(&[(&sweep, sweep.prepare(&args.out, device)?)], &runner),
        Mode::Submit(scheduler, runner) => {
            let prepared = sweep.prepare(&args.out, device)?;
            args.launch.submit(&[(&sweep, prepared)], &*scheduler, &runner, merge)
        }
        Mode::Local(workers) => Ok(local(&sweep, &args.selection.weights, &args.out, &workers)?.0),
    }
}

/// Runs a sweep on this machine, each run in a process of its own.
pub(super) fn local(
    sweep: &Sweep,
    weights: &WeightsArgs,
    out: &Path,
    workers: &Workers,
) -> Result<(ExitCode, Option<Box<Outcome>>)> {
    // A missing device and broken weights are told of before the runs begin.
    let device = open_device(workers.runner.device)?;
    weights.networks(&device)?;
    let prepared = sweep.prepare(out, device.name)?;
    announce(sweep, &prepared);
    interrupt::install()?;
    match execute(sweep, &prepared, workers)? {
        Execution::Stopped => {
            println!("stopped and saved; the same command goes on");
            Ok((ExitCode::from(INTERRUPTED), None))
        }
        Execution::Ended { failed: 0, outcome, .. } => Ok((ExitCode::SUCCESS, outcome)),
        Execution::Ended { failed, outcome, .. } => {
            eprintln!("{failed} of {} runs failed; the same command tries them again", sweep.len());
            Ok((ExitCode::from(FAILED), outcome))
        }
    }
}

/// Makes the table of what is finished.
fn merge(sweep: &Sweep, out: &Path, device: DeviceName) -> Result<ExitCode> {
    let merged = merge_one(sweep, out, device)?;
    Ok(if merged.missing.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FAILED) })
}

/// Merges a sweep, prints its table, and names runs that are not finished.
pub(super) fn merge_one(sweep: &Sweep, out: &Path, device: DeviceName) -> Result<Merged> {
    let merged = sweep.merge(out, device)?;
    if let Some(outcome) = &merged.outcome {
        print_outcome(outcome);
    }
    let (missing, name) = (merged.missing.len(), &sweep.about.name);
    if missing > 0 {
        let few = merged.missing.iter().take(MOST_NAMED).cloned().collect::<Vec<_>>().join(", ");
        let more = if missing > MOST_NAMED { ", ..." } else { "" };
        eprintln!("{name}: {missing} of {} runs are not finished: {few}{more}", sweep.len());
    }
    Ok(merged)
}

/// Says what there is to do.
pub(super) fn announce(sweep: &Sweep, prepared: &Prepared) {
    let State { kept, stale, .. } = prepared.state();
    println!("{}: {} runs, {kept} of them finished before and kept", sweep.about.name, sweep.len());
    if *stale > 0 {
        println!("{stale} finished before with other data, program, device or first weights: run again");
    }
    if let Some(warning) = &prepared.warning {
        eprintln!("warning: {warning}");
    }
    for notice in &sweep.notices {
        println!("{notice}");
    }
}

/// Runs a sweep with a progress bar, and prints its table.
pub(super) fn execute(sweep: &Sweep, prepared: &Prepared, workers: &Workers) -> Result<Execution> {
    let style = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} runs {elapsed}, {eta} left")?;
    let mut bar = ProgressBar::hidden();
    let execution = sweep.execute(prepared, workers, &mut |event| match event {
        SweepEvent::Started { count, label } => {
            bar = ProgressBar::new(count as u64).with_style(style.clone());
            bar.set_prefix(format!("{} {label}", sweep.about.name));
            bar.enable_steady_tick(Duration::from_millis(500));
        }
        SweepEvent::Item { index, label, ended } => {
            bar.suspend(|| match ended {
                Ended::Finished(summary) => println!("[{index}] {label}: {summary}"),
                Ended::Stopped => {}
                Ended::Failed(reason) => eprintln!("[{index}] {label}: failed: {reason}"),
            });
            bar.inc(1);
        }
        SweepEvent::Ended => bar.finish_and_clear(),
        SweepEvent::Dropped { variant, reason } => println!("{variant} is stopped: {reason}"),
    })?;
    if let Execution::Ended { outcome: Some(outcome), .. } = &execution {
        print_outcome(outcome);
    }
    Ok(execution)
}

fn print_outcome(outcome: &Outcome) {
    let Outcome { table, report, results, .. } = outcome;
    println!("\n{}", table.to_text(emphasis()));
    println!("report: {}\nnumbers: {}", report.display(), results.display());
}

pub(crate) fn run_item(args: &SweepItemArgs) -> Result<ExitCode> {
    let device = open_device(args.device.device)?;
    let networks = args.weights.networks(&device)?;
    interrupt::install()?;
    if args.tied {
        std::thread::spawn(end_with_input);
    }
    if let Some(timeout) = args.timeout {
        std::thread::spawn(move || end_after(timeout));
    }
    let mut progress = Progress::new("")?;
    let watch = &mut |event: RunEvent<'_>| progress.watch(event);
    let finished = run_manifest_item(&args.manifest, args.item, device, networks, args.until, watch)?;
    match finished {
        Finished::Record(record, _) => {
            if let Some(bytes) = record.peak_rss_bytes {
                println!("{PEAK_MEMORY}{}", bytes >> 20);
            }
            println!("{}", summary(&record));
        }
        Finished::Kept(_) => println!("finished before, kept"),
        Finished::Stopped if interrupt::asked() => return Ok(ExitCode::from(STOPPED as u8)),
        Finished::Stopped => println!("stopped and saved, to go on later"),
    }
    Ok(ExitCode::SUCCESS)
}

/// Ends the process when its time is up: what is on disk is complete at any time.
fn end_after(timeout: Duration) {
    std::thread::sleep(timeout);
    eprintln!("error: timed out after {} s; what was saved is kept", timeout.as_secs_f64());
    std::process::exit(i32::from(FAILED));
}

/// Ends the process when nobody is left to talk to it: what is on disk is complete at any time.
fn end_with_input() {
    if io::copy(&mut io::stdin(), &mut io::sink()).is_ok() {
        std::process::exit(STOPPED);
    }
}
