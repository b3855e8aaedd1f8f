//! Runs as jobs on other machines, and as printed commands.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::launch::{self, Batch, Launched, Live, Runner, Scheduler, commands};
use infonerf_experiment::sweep::{Prepared, Sweep};

use crate::exit::INTERRUPTED;
use crate::print::{errln, outln};
use crate::{command_line, interrupt};

/// Time between two questions to the scheduler.
const PATIENCE: Duration = Duration::from_secs(5);

/// The unfinished items of `sweeps`.
pub(super) fn batches(sweeps: &[(&Sweep, Prepared)]) -> Result<Vec<Batch>> {
    let batches = sweeps.iter().map(|(sweep, prepared)| sweep.batch(prepared)).collect::<Result<Vec<_>>>()?;
    Ok(batches.into_iter().filter(|batch| !batch.items.is_empty()).collect())
}

/// Prints a command for each item of `batches`, and nothing else.
pub(super) fn print(batches: &[Batch], runner: &Runner) -> Result<ExitCode> {
    for batch in batches {
        for command in commands(batch, runner)? {
            outln!("{command}");
        }
    }
    errln!("one command per unfinished run; then the same command with --merge writes the tables");
    Ok(ExitCode::SUCCESS)
}

/// Submits `batches`. None if they were watched until they had ended: what is left to do is to merge.
pub(super) fn submit(
    batches: Vec<Batch>,
    scheduler: &dyn Scheduler,
    runner: &Runner,
    watched: bool,
) -> Result<Option<ExitCode>> {
    let launched = launch::submit(batches, scheduler, runner, &command_line::merging()?)?;
    outln!("{} runs submitted as {} {}", launched.items(), scheduler.launcher(), launched.jobs.join(", "));
    if watched {
        if watch(&launched, scheduler)? {
            return Ok(None);
        }
        outln!("the jobs continue without this; `{}` ends them", scheduler.cancel(&launched.jobs));
        return Ok(Some(ExitCode::from(INTERRUPTED)));
    }
    match launched.merges {
        true => outln!("the last of them merges; the same command with --merge does so before"),
        false => outln!("the same command with --merge writes the tables"),
    }
    Ok(Some(ExitCode::SUCCESS))
}

/// Shows how far jobs are until they have ended; false if the user wants to see no more of it.
fn watch(launched: &Launched, scheduler: &dyn Scheduler) -> Result<bool> {
    interrupt::install()?;
    let style = ProgressStyle::with_template("{wide_bar} {pos}/{len} runs, {msg} {elapsed}")?;
    let bar = ProgressBar::new(launched.items() as u64).with_style(style);
    loop {
        let progress = launched.progress(scheduler)?;
        let Live { waiting, running } = progress.live;
        bar.set_position(progress.finished as u64);
        bar.set_message(format!("{waiting} tasks wait, {running} run"));
        if waiting + running == 0 {
            bar.finish_and_clear();
            return Ok(true);
        }
        for _ in 0..PATIENCE.as_millis() / 100 {
            if interrupt::asked() {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}
