use infonerf_report::Record;

use crate::plan::{Experiment, Selection};
use crate::run_plan::RunPlan;

pub(crate) fn selected(scenes: &[&str], variants: &[&str], settings: &[&str]) -> Selection {
    let [scenes, variants, set] =
        [scenes, variants, settings].map(|texts| texts.iter().map(|&text| text.to_owned()).collect());
    Selection { scenes, variants, set, ..Selection::default() }
}

/// Returns the first run of the experiment `fast-losses` on the scene `knot`, with `settings`.
pub(crate) fn first_run(settings: &[&str]) -> RunPlan {
    Experiment::plan("fast-losses", &selected(&["knot"], &[], settings)).unwrap().runs.remove(0)
}

pub(crate) fn with_psnr(psnr: f64, record: Record) -> Record {
    Record { metrics: [("psnr".to_owned(), Some(psnr))].into_iter().collect(), ..record }
}
