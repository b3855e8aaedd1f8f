//! From sweeps to their results, wherever their runs happen.

use std::path::Path;
use std::process::ExitCode;
use std::slice;

use anyhow::{Result, bail};
use infonerf_experiment::DeviceName;
use infonerf_experiment::launch::Workers;
use infonerf_experiment::sweep::{Execution, Outcome, Prepared, State, Sweep};

use super::{LaunchArgs, Place, jobs, local};
use crate::exit::{FAILED, INTERRUPTED};
use crate::print::{errln, outln};
use crate::selection::SelectionArgs;
use crate::summary::print_outcome;
use crate::terminal::open_device;
use crate::{command_line, interrupt};

/// Of runs that are not finished, so many are named.
const MOST_NAMED: usize = 8;

/// Runs `sweeps` below `out` where `launch` says, prints their tables, and hands `finish` what came of them.
///
/// # Errors
/// If options do not go together, a sweep cannot be prepared, a scheduler refuses, or a file cannot be written. A run that
/// fails is no error, but an exit code.
pub(crate) fn drive(
    sweeps: &[Sweep],
    selection: &SelectionArgs,
    launch: &LaunchArgs,
    out: &Path,
    finish: impl FnOnce(Vec<Outcome>) -> Result<()>,
) -> Result<ExitCode> {
    let device = selection.device.device.built_in()?;
    let (place, runner) = (launch.place()?, launch.runner(device, &selection.networks)?);
    if matches!(place, Place::Scheduler(_) | Place::Printed) && sweeps.iter().any(|sweep| sweep.halving.is_some()) {
        bail!("--halving: which runs continue is decided on the way: expected --launch local");
    }
    let prepare = || -> Result<Vec<(&Sweep, Prepared)>> {
        sweeps.iter().map(|sweep| Ok((sweep, sweep.prepare(out, device)?))).collect()
    };
    let (unfinished, outcomes) = match place {
        Place::Merged => merge(sweeps, out, device)?,
        Place::Printed => return jobs::print(&jobs::batches(&prepare()?)?, &runner),
        Place::Scheduler(scheduler) => {
            let prepared = prepare()?;
            prepared.iter().for_each(|(sweep, prepared)| announce(sweep, prepared));
            let batches = jobs::batches(&prepared)?;
            if !batches.is_empty()
                && let Some(code) = jobs::submit(batches, &*scheduler, &runner, launch.watch)?
            {
                return Ok(code);
            }
            merge(sweeps, out, device)?
        }
        Place::Here => {
            // A missing device and broken weights are told of before the runs begin.
            selection.networks.open(&open_device(device)?)?;
            let workers = Workers { runner, jobs: launch.jobs.unwrap_or(1) as usize, stop: interrupt::asked };
            let Some(ended) = here(prepare()?, out, &workers)? else {
                outln!("stopped and saved; {} resumes", same_command(sweeps));
                return Ok(ExitCode::from(INTERRUPTED));
            };
            ended
        }
    };
    finish(outcomes)?;
    Ok(if unfinished > 0 { ExitCode::from(FAILED) } else { ExitCode::SUCCESS })
}

/// Runs everything in processes of this machine: how many failed, and what came of the others; none if told to stop.
fn here(sweeps: Vec<(&Sweep, Prepared)>, out: &Path, workers: &Workers) -> Result<Option<(usize, Vec<Outcome>)>> {
    interrupt::install()?;
    let (mut all_failed, mut outcomes) = (0, Vec::new());
    let mut done: Vec<&Sweep> = Vec::new();
    let several = sweeps.len() > 1;
    for (sweep, mut prepared) in sweeps {
        title(sweep, several);
        announce(sweep, &prepared);
        let adopted = sweep.adopt(&mut prepared, &done, out, workers.runner.device)?;
        if adopted > 0 {
            outln!("{adopted} runs are those of experiments above, under other names");
        }
        done.push(sweep);
        command_line::save(&out.join(&sweep.about.name))?;
        let Execution::Ended { failed, outcome } = local::execute(sweep, &prepared, workers)? else { return Ok(None) };
        if failed > 0 {
            let again = same_command(slice::from_ref(sweep));
            errln!("{failed} of {} runs failed; {again} tries them again", sweep.len());
        }
        all_failed += failed;
        outcomes.extend(shown(outcome));
    }
    Ok(Some((all_failed, outcomes)))
}

/// Writes the tables of what is finished: how many runs are not, and what came of the others.
fn merge(sweeps: &[Sweep], out: &Path, device: DeviceName) -> Result<(usize, Vec<Outcome>)> {
    let (mut all_missing, mut outcomes) = (0, Vec::new());
    for sweep in sweeps {
        title(sweep, sweeps.len() > 1);
        let merged = sweep.merge(out, device)?;
        let (missing, name) = (merged.missing.len(), &sweep.about.name);
        outcomes.extend(shown(merged.outcome));
        if missing > 0 {
            let few = merged.missing.iter().take(MOST_NAMED).cloned().collect::<Vec<_>>().join(", ");
            let more = if missing > MOST_NAMED { ", ..." } else { "" };
            errln!("{name}: {missing} of {} runs are not finished: {few}{more}", sweep.len());
        }
        all_missing += missing;
    }
    Ok((all_missing, outcomes))
}

/// Prints an outcome, if there is one, and hands it on.
fn shown(outcome: Option<Box<Outcome>>) -> Option<Outcome> {
    outcome.map(|outcome| {
        print_outcome(&outcome);
        *outcome
    })
}

/// Prints a heading where one is of `several`.
fn title(sweep: &Sweep, several: bool) {
    if several {
        outln!("\n{}", sweep.about.title);
    }
}

/// The command that continues `sweeps`: without `--overwrite`, which would start them over.
fn same_command(sweeps: &[Sweep]) -> &'static str {
    match sweeps.iter().any(|sweep| sweep.overwrites) {
        true => "the same command without --overwrite",
        false => "the same command",
    }
}

/// Says what there is to do.
fn announce(sweep: &Sweep, prepared: &Prepared) {
    let State { kept, .. } = prepared.state();
    outln!("{}: {} runs, {kept} of them finished before and kept", sweep.about.name, sweep.len());
    if let Some(warning) = &prepared.warning {
        errln!("warning: {warning}");
    }
    for notice in &sweep.notices {
        outln!("{notice}");
    }
}
