//! `infonerf sweep`: an experiment for every combination of some values.
//!
//! ```text
//! --grid, --random ─► plan (items) ─► manifest.jsonl ─► workers (a process an item) ─► records ─► table, figures, report
//! ```

mod args;
mod capacity;
mod figures;
mod grid;
mod halving;
mod item;
mod keys;
mod manifest;
mod outcome;
mod plan;
mod random;
mod setting;
mod workers;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_report::{ReportInput, read_records, run_directory};

pub(crate) use args::{Limits, SWEEP_EXAMPLES, SweepArgs, SweepItemArgs};
use halving::{Dropped, drop_worst, rungs};
pub(crate) use item::run as run_item;
pub(crate) use plan::Sweep;
use workers::{Ended, Workers};

use crate::args::DeviceName;
use crate::{device, interrupt, run};

/// Exit code after Ctrl-C.
pub(super) const INTERRUPTED: u8 = 130;
/// Exit code when an item failed.
pub(super) const FAILED: u8 = 1;

pub(crate) fn run(args: &SweepArgs) -> Result<ExitCode> {
    let sweep = Sweep::plan(args)?;
    device::open(args.selection.device)?;
    let prepared = sweep.prepare(&args.out)?;
    if args.manifest_only {
        let last = sweep.items.len() - 1;
        println!("manifest: {} (items 0 to {last})", args.out.join(&sweep.about.name).join(manifest::NAME).display());
        return Ok(ExitCode::SUCCESS);
    }
    interrupt::install()?;
    let run = Run { limits: &args.limits, device: args.selection.device, halving: args.halving };
    match sweep.execute(&prepared, &run)? {
        Execution::Interrupted => {
            println!("stopped and saved; the same command goes on");
            Ok(ExitCode::from(INTERRUPTED))
        }
        Execution::Ended { failed: 0, .. } => Ok(ExitCode::SUCCESS),
        Execution::Ended { failed, .. } => {
            eprintln!("{failed} of {} runs failed; the same command tries them again", sweep.items.len());
            Ok(ExitCode::from(FAILED))
        }
    }
}

/// How a sweep is run.
pub(crate) struct Run<'a> {
    pub(crate) limits: &'a Limits,
    pub(crate) device: DeviceName,
    /// Of how many settings one goes on at each rung.
    pub(crate) halving: Option<u32>,
}

/// A sweep's folder, its manifest written, and which of its items are to do.
pub(crate) struct Prepared {
    folder: PathBuf,
    missing: Vec<usize>,
    /// Bytes that the largest of the finished runs took.
    peak: Option<u64>,
}

/// What came of a sweep.
pub(crate) enum Execution {
    /// By the user; it can go on.
    Interrupted,
    /// All that can be done is done.
    Ended {
        /// Items without a record, but for those of settings that were stopped early.
        failed: usize,
        /// What its report is made of; none without any record.
        report: Option<Box<ReportInput>>,
    },
}

impl Sweep {
    /// Writes the manifest below `out` and finds what is to do, which it tells.
    pub(crate) fn prepare(&self, out: &Path) -> Result<Prepared> {
        let folder = out.join(&self.about.name);
        let path = folder.join(manifest::NAME);
        manifest::refuse_another_version(&path)?;
        let prepared = self.missing(folder)?;
        manifest::write(&path, &self.items)?;
        let (total, kept) = (self.items.len(), self.items.len() - prepared.missing.len());
        println!("{}: {total} runs, {kept} of them finished before and kept", self.about.name);
        for notice in &self.notices {
            println!("{notice}");
        }
        Ok(prepared)
    }

    /// Runs what is missing, and writes tables and the report.
    pub(crate) fn execute(&self, prepared: &Prepared, run: &Run) -> Result<Execution> {
        let folder = &prepared.folder;
        let manifest = folder.join(manifest::NAME);
        let mut workers = Workers { manifest: &manifest, limits: run.limits, device: run.device, until: None };
        let (mut items, mut dropped) = ((0..self.items.len()).collect::<Vec<usize>>(), Vec::new());
        if let Some(keep) = run.halving {
            let settings: BTreeSet<&str> = self.items.iter().map(|item| item.plan.variant.as_str()).collect();
            for share in rungs(settings.len(), keep) {
                let behind = |item: &usize| halving::score(folder, &self.items[*item].plan, share).is_none();
                workers.until = Some(share);
                let label = format!("to {:.1} %", 100.0 * share);
                let todo = items.iter().copied().filter(behind).collect();
                let Some(_) = self.run_items(&workers, todo, prepared.peak, &label)? else {
                    return Ok(Execution::Interrupted);
                };
                let worst = drop_worst(self, folder, &mut items, keep, share);
                for Dropped { variant, reason } in &worst {
                    println!("{variant} is stopped: {reason}");
                }
                dropped.extend(worst);
            }
            workers.until = None;
        }
        items.retain(|item| prepared.missing.contains(item));
        let Some(failed) = self.run_items(&workers, items, prepared.peak, "")? else {
            return Ok(Execution::Interrupted);
        };
        let stopped = |Dropped { variant, reason }: Dropped| format!("{variant} was stopped early: {reason}.");
        let report = outcome::write(self, folder, dropped.into_iter().map(stopped).collect())?;
        Ok(Execution::Ended { failed, report: report.map(Box::new) })
    }

    /// The items that are not finished.
    fn missing(&self, folder: PathBuf) -> Result<Prepared> {
        let (mut missing, mut peak) = (Vec::new(), None);
        for (index, item) in self.items.iter().enumerate() {
            let plan = &item.plan;
            let run = folder.join(run_directory(&plan.scene, &plan.variant, plan.seed));
            let path = run.join("config.toml");
            let known = path.exists();
            if known && fs::read_to_string(&path).with_context(|| path.display().to_string())? != plan.to_toml()? {
                bail!(
                    "{}: a run of this name has another config: choose another --out, or move it away",
                    path.display()
                );
            }
            let record = run::record_path(&run, plan);
            if known && record.exists() {
                peak = peak.max(read_records(&record)?.iter().filter_map(|record| record.peak_rss_bytes).max());
            } else {
                missing.push(index);
            }
        }
        Ok(Prepared { folder, missing, peak })
    }

    /// Runs items and tells how many failed; nothing if the user stopped them.
    fn run_items(&self, workers: &Workers, items: Vec<usize>, peak: Option<u64>, label: &str) -> Result<Option<usize>> {
        let bar = ProgressBar::new(items.len() as u64);
        bar.set_style(ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} runs {elapsed}, {eta} left")?);
        bar.set_prefix(format!("{} {label}", self.about.name));
        bar.enable_steady_tick(Duration::from_millis(500));
        let (mut failed, mut interrupted) = (0, 0);
        workers.run(items, peak, |index, ended| {
            let label = self.items.get(index).map_or_else(String::new, |item| item.plan.label());
            bar.suspend(|| match ended {
                Ended::Finished(summary) => println!("[{index}] {label}: {summary}"),
                Ended::Interrupted => interrupted += 1,
                Ended::Failed(reason) => {
                    failed += 1;
                    eprintln!("[{index}] {label}: failed: {reason}");
                }
            });
            bar.inc(1);
        });
        bar.finish_and_clear();
        Ok((interrupted == 0 && !interrupt::asked()).then_some(failed))
    }
}
