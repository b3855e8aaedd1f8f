//! `infonerf sweep-item`: one item of a manifest; a finished one is kept.

use std::io;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use infonerf_report::save_record;

use super::args::SweepItemArgs;
use super::{INTERRUPTED, manifest};
use crate::command::exp::summary;
use crate::run::{Finished, Session};
use crate::{device, interrupt};

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
    let session = Session { device, device_name, out: out.to_owned(), resume: true };
    match session.run(&plan)? {
        Finished::Record(record, _) => {
            save_record(folder, &record)?;
            println!("{}", summary(&record));
        }
        Finished::Kept => println!("finished before, kept"),
        Finished::Interrupted => return Ok(ExitCode::from(INTERRUPTED)),
    }
    Ok(ExitCode::SUCCESS)
}

/// Ends the process when nobody is left to talk to it: what is on disk is complete at any time.
fn end_with_input() {
    if io::copy(&mut io::stdin(), &mut io::sink()).is_ok() {
        std::process::exit(i32::from(INTERRUPTED));
    }
}
