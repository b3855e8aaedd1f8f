//! Plans for tests.

use crate::{Experiment, RunPlan, Selection};

/// The first run of the experiment called `experiment`, on one scene if `scene` is not empty, with `settings`.
pub(crate) fn first_run(experiment: &str, scene: &str, settings: &[&str]) -> RunPlan {
    let owned = |texts: &[&str]| texts.iter().map(|&text| text.to_owned()).collect();
    let scenes = if scene.is_empty() { Vec::new() } else { owned(&[scene]) };
    let selection = Selection { scenes, set: owned(settings), ..Selection::default() };
    Experiment::plan(experiment, &selection).unwrap().runs.remove(0)
}
