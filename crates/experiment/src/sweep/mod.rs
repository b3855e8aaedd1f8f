//! An experiment for every combination of some values.
//!
//! ```text
//! grids, random draws ─► plan (items) ─► manifest.jsonl ─► launcher (a process per item) ─► records ─► table, figures, report
//! ```

mod adopt;
mod best;
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
#[cfg(test)]
mod scale_test;
mod setting;

use std::collections::{BTreeSet, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use infonerf_report::read_records;

use crate::launch::{Batch, Ended, Queue, Workers, refuse_under_way};
use crate::run::{clear, lock};
use crate::{DeviceName, Identity, RunPlan};
use halving::{Dropped, drop_worst, rungs};
pub use item::run_item;
pub use options::{PAPER_SPACE, SweepOptions};
pub use outcome::Outcome;
use plan::Item;
pub use plan::Sweep;

/// Events of a sweep.
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

/// A sweep's folder, its manifest written, and which of its items are to do. No other process prepares the same sweep for
/// as long as this lives.
pub struct Prepared {
    state: State,
    /// A notice for the user.
    pub warning: Option<String>,
    _lock: fs::File,
}

/// Which items of a sweep are finished.
pub struct State {
    folder: PathBuf,
    device: DeviceName,
    missing: Vec<usize>,
    /// Bytes that the largest of the finished runs took.
    peak: Option<u64>,
    /// Number of runs that were finished before and are kept.
    pub kept: usize,
}

impl Prepared {
    /// Which items are finished.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The manifest: one line per item.
    pub fn manifest(&self) -> PathBuf {
        self.state.folder.join(manifest::NAME)
    }
}

/// The result of a merge.
pub struct Merged {
    /// The runs that are not finished.
    pub missing: Vec<String>,
    /// The files written; none without any record.
    pub outcome: Option<Box<Outcome>>,
}

/// How a sweep ended.
pub enum Execution {
    /// It was told to stop, and can be resumed.
    Stopped,
    /// All that can be done is done.
    Ended {
        /// Items without a record, but for those of settings that were stopped early.
        failed: usize,
        /// The files written; none without any record.
        outcome: Option<Box<Outcome>>,
    },
}

impl Sweep {
    /// Writes the manifest below `out` and finds what is to do on `device`.
    ///
    /// # Errors
    /// If another process or a launch is at work on it, or a manifest of another version or a run of another config is in
    /// the way.
    pub fn prepare(&self, out: &Path, device: DeviceName) -> Result<Prepared> {
        let folder = out.join(&self.about.name);
        let path = folder.join(manifest::NAME);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let (lock, warning) = lock(&folder, "sweep")?;
        manifest::refuse_another_version(&path)?;
        refuse_under_way(&folder)?;
        if self.overwrites {
            self.remove_runs(&folder)?;
        }
        let state = self.state(out, device)?;
        manifest::write(&path, &self.items)?;
        Ok(Prepared { state, warning, _lock: lock })
    }

    /// The items that are to do, for a launcher.
    ///
    /// # Errors
    /// If the current folder is not known.
    pub fn batch(&self, prepared: &Prepared) -> Result<Batch> {
        let State { folder, missing, .. } = &prepared.state;
        let folder = std::path::absolute(folder).with_context(|| folder.display().to_string())?;
        let record = |item: &usize| {
            let plan = &self.items[*item].plan;
            plan.record_path(&folder.join(plan.directory()))
        };
        Ok(Batch {
            name: self.about.name.clone(),
            manifest: folder.join(manifest::NAME),
            items: missing.clone(),
            records: missing.iter().map(record).collect(),
            folder,
        })
    }

    /// Writes tables and the report of what is finished below `out`, whatever made it, without running anything.
    ///
    /// # Errors
    /// If a run of another config is in the way, or a file cannot be read or written.
    pub fn merge(&self, out: &Path, device: DeviceName) -> Result<Merged> {
        let state = self.state(out, device)?;
        let left_out: HashSet<usize> = state.missing.iter().copied().collect();
        let missing = state.missing.iter().map(|item| self.items[*item].plan.label()).collect();
        let outcome = outcome::write(self, &state.folder, &left_out, Vec::new())?;
        Ok(Merged { missing, outcome: outcome.map(Box::new) })
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
        let (folder, manifest) = (&prepared.state.folder, prepared.manifest());
        let State { missing, peak, device, .. } = &prepared.state;
        let mut queue = Queue { manifest: &manifest, workers, until: None };
        let (mut items, mut dropped) = ((0..self.items.len()).collect::<Vec<usize>>(), Vec::new());
        if let Some(keep) = self.halving {
            let settings: BTreeSet<&str> = self.items.iter().map(|item| item.plan.variant.as_str()).collect();
            for share in rungs(settings.len(), keep) {
                queue.until = Some(share);
                let label = format!("to {:.1} %", 100.0 * share);
                let mut todo = Vec::new();
                for &item in &items {
                    let plan = &self.items[item].plan;
                    if is_stale(plan, folder, *device)? || halving::score(folder, plan, share).is_none() {
                        todo.push(item);
                    }
                }
                let Some(_) = self.run_items(&queue, todo, *peak, label, watch) else {
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
        let todo: HashSet<usize> = missing.iter().copied().collect();
        items.retain(|item| todo.contains(item));
        let Some(failed) = self.run_items(&queue, items, *peak, String::new(), watch) else {
            return Ok(Execution::Stopped);
        };
        let stopped = |Dropped { variant, reason }: Dropped| format!("{variant} was stopped early: {reason}.");
        let outcome = outcome::write(self, folder, &failed, dropped.into_iter().map(stopped).collect())?;
        Ok(Execution::Ended { failed: failed.len(), outcome: outcome.map(Box::new) })
    }

    /// Removes what its runs left in `folder`, once no other process is at work on any of them.
    fn remove_runs(&self, folder: &Path) -> Result<()> {
        let runs = self.runs().map(|plan| folder.join(plan.directory())).filter(|run| run.exists());
        let locked = runs.map(|run| Ok((lock(&run, "run")?, run))).collect::<Result<Vec<_>>>()?;
        for (_lock, run) in &locked {
            clear(run)?;
        }
        Ok(())
    }

    /// Which items are finished on `device`, below `out`.
    fn state(&self, out: &Path, device: DeviceName) -> Result<State> {
        let mut state =
            State { folder: out.join(&self.about.name), device, missing: Vec::new(), peak: None, kept: 0 };
        for (index, Item { plan, .. }) in self.items.iter().enumerate() {
            let run = state.folder.join(plan.directory());
            if run.join("config.toml").exists() {
                Identity::of(plan, device.name())?.refuse_another(&run, &plan.to_toml()?)?;
            }
            let record = plan.record_path(&run);
            if record.exists() {
                state.kept += 1;
                let peaks = read_records(&record)?.into_iter().filter_map(|record| record.peak_rss_bytes);
                state.peak = state.peak.max(peaks.max());
            } else {
                state.missing.push(index);
            }
        }
        Ok(state)
    }

    /// Runs items and tells which failed; nothing if they were told to stop.
    fn run_items(
        &self,
        queue: &Queue<'_>,
        items: Vec<usize>,
        peak: Option<u64>,
        label: String,
        watch: &mut dyn FnMut(SweepEvent<'_>),
    ) -> Option<HashSet<usize>> {
        watch(SweepEvent::Started { count: items.len(), label });
        let (mut failed, mut stopped) = (HashSet::new(), 0);
        queue.run(items, peak, |index, ended| {
            match &ended {
                Ended::Finished(_) => {}
                Ended::Stopped => stopped += 1,
                Ended::Failed(_) => drop(failed.insert(index)),
            }
            let label = self.items.get(index).map_or_else(String::new, |item| item.plan.label());
            watch(SweepEvent::Item { index, label, ended: &ended });
        });
        watch(SweepEvent::Ended);
        (stopped == 0 && !(queue.workers.stop)()).then_some(failed)
    }
}

/// Whether what a run logged is of other images, another program or another device than it would be now, and judges nothing.
fn is_stale(plan: &RunPlan, folder: &Path, device: DeviceName) -> Result<bool> {
    let run = folder.join(plan.directory());
    Ok(run.join("config.toml").exists() && Identity::read(&run) != Some(Identity::of(plan, device.name())?))
}
