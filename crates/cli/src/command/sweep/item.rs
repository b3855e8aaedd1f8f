//! `infonerf sweep-item`: one item of a manifest; a finished one is kept.

use std::io;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use infonerf_report::save_record;

use super::args::SweepItemArgs;
use super::{FAILED, INTERRUPTED, manifest};
use crate::command::exp::summary;
use crate::run::{Finished, Session, peak_rss};
use crate::{device, interrupt};

/// Says how much memory the process took, in MiB, at the start of a line.
pub(super) const PEAK_MEMORY: &str = "peak memory (MiB): ";

pub(crate) fn run(args: &SweepItemArgs) -> Result<ExitCode> {
    let plan = manifest::read_item(&args.manifest, args.item)?;
    let path = std::path::absolute(&args.manifest).with_context(|| args.manifest.display().to_string())?;
    let folder = path.parent().filter(|folder| folder.file_name().is_some_and(|name| *name == *plan.experiment));
    let Some((folder, out)) = folder.and_then(|folder| Some((folder, folder.parent()?))) else {
        bail!("{}: expected to be in the folder {}", path.display(), plan.experiment);
    };
    let (device, device_name) = device::open(args.device)?;
    interrupt::install()?;
    if args.tied {
        std::thread::spawn(end_with_input);
    }
    if let Some(timeout) = args.timeout {
        std::thread::spawn(move || end_after(timeout));
    }
    let session = Session { device, device_name, out: out.to_owned(), resume: true, until: args.until };
    let finished = session.run(&plan)?;
    if let Some(bytes) = peak_rss() {
        println!("{PEAK_MEMORY}{}", bytes >> 20);
    }
    match finished {
        Finished::Record(record, _) => {
            save_record(folder, &record)?;
            println!("{}", summary(&record));
        }
        Finished::Kept => println!("finished before, kept"),
        Finished::Stopped if interrupt::asked() => return Ok(ExitCode::from(INTERRUPTED)),
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
        std::process::exit(i32::from(INTERRUPTED));
    }
}
