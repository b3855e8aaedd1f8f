//! Selections and plans for tests.

use crate::plan::{Experiment, Selection};
use crate::run_plan::RunPlan;

/// Returns the selection of some scenes, variants and settings.
pub(crate) fn selected(scenes: &[&str], variants: &[&str], settings: &[&str]) -> Selection {
    let [scenes, variants, set] =
        [scenes, variants, settings].map(|texts| texts.iter().map(|&text| text.to_owned()).collect());
    Selection { scenes, variants, set, ..Selection::default() }
}

/// Returns the first run of the experiment called `experiment`, on one scene if `scene` is not empty, with `settings`.
pub(crate) fn first_run(experiment: &str, scene: &str, settings: &[&str]) -> RunPlan {
    let scenes: &[&str] = if scene.is_empty() { &[] } else { &[scene] };
    Experiment::plan(experiment, &selected(scenes, &[], settings)).unwrap().runs.remove(0)
}
