//! An experiment for every combination of some values.
//!
//! ```text
//! grids, random draws ─► plan (items) ─► manifest.jsonl ─► workers (a process per item) ─► records ─► table, figures, report
//! ```

mod capacity;
mod figures;
mod grid;
mod halving;
mod item;
mod keys;
mod manifest;
mod options;
mod outcome;
mod plan;
mod random;
mod setting;
mod workers;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use infonerf_report::read_records;

use crate::{Identity, RunPlan};
use halving::{Dropped, drop_worst, rungs};
pub use item::{PEAK_MEMORY, run_item};
pub use options::{SweepOptions, Workers};
pub use outcome::Outcome;
use plan::Item;
pub use plan::Sweep;
use workers::Queue;

/// Exit code of an item's process that was told to stop, and saved.
pub const STOPPED: i32 = 130;

/// How an item's process ended.
#[derive(Clone, Debug)]
pub enum Ended {
    /// With a record, or as far as it was asked to; what it said.
    Finished(String),
    /// Saved, when told to stop.
    Stopped,
    /// Without a record; why.
    Failed(String),
}

/// What happens in a sweep, for whoever watches it.
#[derive(Debug)]
pub enum SweepEvent<'a> {
    /// Some items are about to be run.
    Started {
        /// How many.
        count: usize,
        /// How far; empty for to the end.
        label: String,
    },
    /// An item's process ended.
    Item {
        /// Which item.
        index: usize,
        /// The run.
        label: String,
        /// How.
        ended: &'a Ended,
    },
    /// All of them have ended.
    Ended,
    /// A setting is stopped early.
    Dropped {
        /// The variant with its values.
        variant: &'a str,
        /// Why.
        reason: &'a str,
    },
}

/// A sweep's folder, its manifest written, and which of its items are to do.
pub struct Prepared {
    folder: PathBuf,
    missing: Vec<usize>,
    /// Bytes that the largest of the finished runs took.
    peak: Option<u64>,
    /// Number of runs that were finished before and are kept.
    pub kept: usize,
    /// Number of runs that were finished before and are run again, since what their numbers depend on has changed.
    pub stale: usize,
}

impl Prepared {
    /// The manifest: one line per item.
    pub fn manifest(&self) -> PathBuf {
        self.folder.join(manifest::NAME)
    }
}

/// What came of a sweep.
pub enum Execution {
    /// It was told to stop, and can go on.
    Stopped,
    /// All that can be done is done.
    Ended {
        /// Items without a record, but for those of settings that were stopped early.
        failed: usize,
        /// What was written; none without any record.
        outcome: Option<Box<Outcome>>,
    },
}

impl Sweep {
    /// Writes the manifest below `out` and finds what is to do on `device`.
    ///
    /// # Errors
    /// If a manifest of another version, or a run of another config, is in the way.
    pub fn prepare(&self, out: &Path, device: &str) -> Result<Prepared> {
        let folder = out.join(&self.about.name);
        let path = folder.join(manifest::NAME);
        manifest::refuse_another_version(&path)?;
        let prepared = self.missing(folder, device)?;
        manifest::write(&path, &self.items)?;
        Ok(prepared)
    }

    /// Runs what is missing, and writes tables and the report.
    ///
    /// # Errors
    /// If a file cannot be written. A run that fails is no error.
    pub fn execute(
        &self,
        prepared: &Prepared,
        workers: &Workers,
        watch: &mut dyn FnMut(SweepEvent<'_>),
    ) -> Result<Execution> {
        let folder = &prepared.folder;
        let manifest = prepared.manifest();
        let mut queue = Queue { manifest: &manifest, workers, until: None };
        let (mut items, mut dropped) = ((0..self.items.len()).collect::<Vec<usize>>(), Vec::new());
        if let Some(keep) = self.halving {
            let settings: BTreeSet<&str> = self.items.iter().map(|item| item.plan.variant.as_str()).collect();
            for share in rungs(settings.len(), keep) {
                let behind = |item: &usize| halving::score(folder, &self.items[*item].plan, share).is_none();
                queue.until = Some(share);
                let label = format!("to {:.1} %", 100.0 * share);
                let todo = items.iter().copied().filter(behind).collect();
                let Some(_) = self.run_items(&queue, todo, prepared.peak, label, watch) else {
                    return Ok(Execution::Stopped);
                };
                let worst = drop_worst(self, folder, &mut items, keep, share);
                for Dropped { variant, reason } in &worst {
                    watch(SweepEvent::Dropped { variant, reason });
                }
                dropped.extend(worst);
            }
            queue.until = None;
        }
        items.retain(|item| prepared.missing.contains(item));
        let Some(failed) = self.run_items(&queue, items, prepared.peak, String::new(), watch) else {
            return Ok(Execution::Stopped);
        };
        let stopped = |Dropped { variant, reason }: Dropped| format!("{variant} was stopped early: {reason}.");
        let outcome = outcome::write(self, folder, dropped.into_iter().map(stopped).collect())?;
        Ok(Execution::Ended { failed, outcome: outcome.map(Box::new) })
    }

    /// The items that are not finished.
    fn missing(&self, folder: PathBuf, device: &str) -> Result<Prepared> {
        let mut prepared = Prepared { folder, missing: Vec::new(), peak: None, kept: 0, stale: 0 };
        for (index, Item { plan, .. }) in self.items.iter().enumerate() {
            let run = prepared.folder.join(plan.directory());
            refuse_another_config(plan, &run)?;
            let record = plan.record_path(&run);
            if !record.exists() {
                prepared.missing.push(index);
            } else if Identity::read(&run) == Some(Identity::of(plan, device)?) {
                prepared.kept += 1;
                let peaks = read_records(&record)?.into_iter().filter_map(|record| record.peak_rss_bytes);
                prepared.peak = prepared.peak.max(peaks.max());
            } else {
                prepared.stale += 1;
                prepared.missing.push(index);
            }
        }
        Ok(prepared)
    }

    /// Runs items and tells how many failed; nothing if they were told to stop.
    fn run_items(
        &self,
        queue: &Queue<'_>,
        items: Vec<usize>,
        peak: Option<u64>,
        label: String,
        watch: &mut dyn FnMut(SweepEvent<'_>),
    ) -> Option<usize> {
        watch(SweepEvent::Started { count: items.len(), label });
        let (mut failed, mut stopped) = (0, 0);
        queue.run(items, peak, |index, ended| {
            match &ended {
                Ended::Finished(_) => {}
                Ended::Stopped => stopped += 1,
                Ended::Failed(_) => failed += 1,
            }
            let label = self.items.get(index).map_or_else(String::new, |item| item.plan.label());
            watch(SweepEvent::Item { index, label, ended: &ended });
        });
        watch(SweepEvent::Ended);
        (stopped == 0 && !(queue.workers.stop)()).then_some(failed)
    }
}

/// A run of the same name with other settings is not overwritten.
fn refuse_another_config(plan: &RunPlan, run: &Path) -> Result<()> {
    let path = run.join("config.toml");
    if path.exists() && fs::read_to_string(&path).with_context(|| path.display().to_string())? != plan.to_toml()? {
        bail!("{}: a run of this name has another config: choose another --out, or move it away", path.display());
    }
    Ok(())
}
