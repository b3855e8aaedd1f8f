use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use clap::Args;
use infonerf_experiment::sweep::run_item;
use infonerf_experiment::{Finished, RunEvent};

use crate::interrupt;
use crate::print::{errln, outln};
use crate::progress::ProgressDisplay;
use crate::reporter::summary;
use crate::selection::{DeviceArgs, NetworkArgs};
use crate::terminal::open_device;
use crate::units::parse_time;

/// Run one item of a sweep's manifest, as the jobs of --launch do.
#[derive(Debug, Args)]
pub(crate) struct SweepItemArgs {
    /// The manifest.jsonl of a sweep; results go into its folder
    manifest: PathBuf,
    /// Index of the item, from 0
    item: usize,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    networks: NetworkArgs,
    /// Give up after this time, such as 10m; what was saved is kept
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    timeout: Option<Duration>,
    /// Stop when standard input is closed, as it is when the parent process ends
    #[arg(long, hide = true)]
    tied: bool,
}

pub(crate) fn run(args: &SweepItemArgs) -> Result<ExitCode> {
    let device = open_device(args.device.device)?;
    let networks = args.networks.open(&device)?;
    interrupt::install()?;
    if args.tied {
        std::thread::spawn(stop_with_input);
    }
    let start = Instant::now();
    if let Some(timeout) = args.timeout {
        std::thread::spawn(move || end_after(timeout));
    }
    let (mut progress, mut step) = (ProgressDisplay::new(""), 0);
    let mut watch = |event: RunEvent<'_>| {
        if let RunEvent::Training { trainer, .. } = &event {
            step = trainer.progress().step;
        }
        progress.watch(event)
    };
    match run_item(&args.manifest, args.item, device, networks, &mut watch)? {
        Finished::Record(record, _) => outln!("{}", summary(&record)),
        Finished::AlreadyDone(_) => outln!("finished before and kept"),
        Finished::Stopped => match args.timeout.filter(|timeout| start.elapsed() >= *timeout) {
            Some(timeout) if step > 0 => bail!("timed out after {} s; saved at step {step}", timeout.as_secs_f64()),
            Some(timeout) => bail!("timed out after {} s; what was saved is kept", timeout.as_secs_f64()),
            None => return Ok(interrupt::exit_code()),
        },
    }
    Ok(ExitCode::SUCCESS)
}

/// Stops the run after `timeout`, and ends the process max(10 s, 5 % of `timeout`) later: files on disk are always complete.
fn end_after(timeout: Duration) {
    std::thread::sleep(timeout);
    interrupt::request_stop();
    std::thread::sleep(Duration::from_secs(10).max(timeout / 20));
    errln!("error: timed out after {} s; what was saved is kept", timeout.as_secs_f64());
    std::process::exit(1);
}

/// Stops the run after its current step, and saves it, once the parent process closes the pipe to this one.
fn stop_with_input() {
    if io::copy(&mut io::stdin(), &mut io::sink()).is_ok() {
        interrupt::request_stop();
    }
}
