//! A sweep on this machine, with a progress bar.

use std::time::Duration;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use infonerf_experiment::launch::{Ended, Workers};
use infonerf_experiment::sweep::{Execution, Prepared, Sweep, SweepEvent};

use crate::print::{errln, outln};

/// Runs what is missing of `sweep`, and tells of each run that ends.
pub(super) fn execute(sweep: &Sweep, prepared: &Prepared, workers: &Workers) -> Result<Execution> {
    let style = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} runs {elapsed}, {eta} left")?;
    let mut bar = ProgressBar::hidden();
    sweep.execute(prepared, workers, &mut |event| match event {
        SweepEvent::Started { count, label } => {
            bar = ProgressBar::new(count as u64).with_style(style.clone());
            bar.set_prefix(format!("{} {label}", sweep.about.name));
            bar.enable_steady_tick(Duration::from_millis(500));
        }
        SweepEvent::Item { index, label, ended } => {
            bar.suspend(|| match ended {
                Ended::Finished(summary) => outln!("[{index}] {label}: {summary}"),
                Ended::Stopped => {}
                Ended::Failed(reason) => errln!("[{index}] {label}: failed: {reason}"),
            });
            bar.inc(1);
        }
        SweepEvent::Ended => bar.finish_and_clear(),
        SweepEvent::Dropped { variant, reason } => outln!("{variant} is stopped: {reason}"),
    })
}
