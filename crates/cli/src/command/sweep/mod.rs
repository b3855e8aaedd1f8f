//! `infonerf sweep`: an experiment for every combination of some values.
//!
//! ```text
//! --grid ─► plan (items) ─► manifest.jsonl ─► workers (a process an item) ─► records ─► table, figures, report
//! ```

mod args;
mod figures;
mod grid;
mod item;
mod manifest;
mod outcome;
mod plan;
mod workers;

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_report::run_directory;

pub(crate) use args::{SWEEP_EXAMPLES, SweepArgs, SweepItemArgs};
pub(crate) use item::run as run_item;
use plan::{Item, Sweep};
use workers::{Ended, Workers};

use crate::{device, interrupt, run};

/// Exit code after Ctrl-C.
const INTERRUPTED: u8 = 130;
/// Exit code when an item failed.
const FAILED: u8 = 1;

pub(crate) fn run(args: &SweepArgs) -> Result<ExitCode> {
    let sweep = Sweep::plan(args)?;
    device::open(args.selection.device)?;
    let folder = args.out.join(&sweep.name);
    let manifest = folder.join(manifest::NAME);
    manifest::refuse_another_version(&manifest)?;
    let missing = missing(&sweep, &folder)?;
    manifest::write(&manifest, &sweep.items)?;
    let (total, kept) = (sweep.items.len(), sweep.items.len() - missing.len());
    println!("{}: {total} runs, {kept} of them finished before and kept", sweep.name);
    for notice in &sweep.notices {
        println!("{notice}");
    }
    if args.manifest_only {
        println!("manifest: {} (items 0 to {})", manifest.display(), total - 1);
        return Ok(ExitCode::SUCCESS);
    }
    let workers = Workers { manifest: &manifest, jobs: args.jobs as usize, device: args.selection.device };
    let (failed, interrupted) = run_items(&sweep, &workers, missing)?;
    if interrupted > 0 || interrupt::asked() {
        println!("stopped and saved; the same command goes on");
        return Ok(ExitCode::from(INTERRUPTED));
    }
    outcome::write(&sweep, &folder)?;
    if failed > 0 {
        eprintln!("{failed} of {total} runs failed; the same command tries them again");
        return Ok(ExitCode::from(FAILED));
    }
    Ok(ExitCode::SUCCESS)
}

/// The items that are not finished.
fn missing(sweep: &Sweep, folder: &Path) -> Result<Vec<usize>> {
    let mut missing = Vec::new();
    for (index, Item { plan, .. }) in sweep.items.iter().enumerate() {
        let folder = folder.join(run_directory(&plan.scene, &plan.variant, plan.seed));
        let path = folder.join("config.toml");
        let known = path.exists();
        if known && fs::read_to_string(&path).with_context(|| path.display().to_string())? != plan.to_toml()? {
            bail!("{}: a run of this name has another config: choose another --out, or move it away", path.display());
        }
        if !(known && run::record_path(&folder, plan).exists()) {
            missing.push(index);
        }
    }
    Ok(missing)
}

/// Runs items and tells how many failed and how many were interrupted.
fn run_items(sweep: &Sweep, workers: &Workers, missing: Vec<usize>) -> Result<(usize, usize)> {
    interrupt::install()?;
    let bar = ProgressBar::new(missing.len() as u64);
    bar.set_style(ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} runs {elapsed}, {eta} left")?);
    bar.set_prefix(sweep.name.clone());
    bar.enable_steady_tick(std::time::Duration::from_millis(500));
    let (mut failed, mut interrupted) = (0, 0);
    workers.run(missing, |index, ended| {
        let label = sweep.items.get(index).map_or_else(String::new, |item| item.plan.label());
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
    Ok((failed, interrupted))
}
