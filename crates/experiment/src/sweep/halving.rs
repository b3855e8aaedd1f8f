//! Successive halving (Jamieson and Talwalkar 2016): hopeless settings are stopped early.
//!
//! Settings are judged by how well they fit the images that they are trained on, over the steps before a rung: a step's rays are
//! drawn at random, and its PSNR is taken before it learns from them. Test views have no part in it. The judgement is
//! read from what the runs logged, so that a resumed sweep judges alike.

use std::collections::HashSet;
use std::path::Path;

use indexmap::IndexMap;
use infonerf_report::{Events, StepEvent};

use super::plan::{Item, Sweep};
use crate::RunPlan;

/// At most so many rungs: the first has to leave time to learn something.
const MOST_RUNGS: u32 = 3;
/// Share of the steps before a rung that are averaged.
const WINDOW: f64 = 0.25;

/// Fractions of a run, rising, after which one of `keep` settings continues, for as long as more than one is left.
pub(super) fn rungs(settings: usize, keep: u32) -> Vec<f64> {
    let count = settings.max(1).ilog(keep as usize).min(MOST_RUNGS);
    (1..=count).rev().map(|rung| f64::from(keep).powi(-(rung as i32))).collect()
}

/// Settings that were stopped, each with why.
pub(super) struct Dropped {
    pub(super) variant: String,
    pub(super) reason: String,
}

/// Takes away from `items` all but the best of their settings at `share` of the run: one of `keep`, rounded up.
///
/// A setting is a variant's name with its values, its score the mean over its scenes and seeds. One without any score,
/// because its runs failed, stays, so that it is tried again and told.
pub(super) fn drop_worst(sweep: &Sweep, folder: &Path, items: &mut Vec<usize>, keep: u32, share: f64) -> Vec<Dropped> {
    let mut settings: IndexMap<&str, Vec<f64>> = IndexMap::new();
    for Item { plan, .. } in items.iter().filter_map(|&item| sweep.items.get(item)) {
        settings.entry(&plan.variant).or_default().extend(score(folder, plan, share));
    }
    let mean = |scores: &[f64]| scores.iter().sum::<f64>() / scores.len() as f64;
    let scored = settings.into_iter().filter(|(_, scores)| !scores.is_empty());
    let mut ranked: Vec<(&str, f64)> = scored.map(|(variant, scores)| (variant, mean(&scores))).collect();
    // Stable: settings that are equally good stay in their order.
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    let kept = ranked.len().div_ceil(keep as usize);
    let last = kept.checked_sub(1).map_or(f64::NAN, |last| ranked[last].1);
    let reason = |score: f64| {
        let percent = 100.0 * share;
        format!(
            "training PSNR {score:.2} dB after {percent:.1} % of the run; those that went on had {last:.2} dB or more"
        )
    };
    let worst = ranked.split_off(kept);
    let gone: HashSet<&str> = worst.iter().map(|&(variant, _)| variant).collect();
    items.retain(|&item| !gone.contains(sweep.items[item].plan.variant.as_str()));
    worst.into_iter().map(|(variant, score)| Dropped { variant: variant.to_owned(), reason: reason(score) }).collect()
}

/// Mean PSNR of training rays over the last steps before `share` of the run, over all of its fields, from what they
/// logged; none if they have not got that far.
pub(super) fn score(folder: &Path, plan: &RunPlan, share: f64) -> Option<f64> {
    let run = folder.join(plan.directory());
    let members = (0..plan.members()).map(|member| member_score(&plan.member_folder(&run, member), plan, share));
    let scores: Vec<f64> = members.collect::<Option<_>>()?;
    Some(scores.iter().sum::<f64>() / scores.len() as f64)
}

fn member_score(folder: &Path, plan: &RunPlan, share: f64) -> Option<f64> {
    let events = Events::read(&folder.join("metrics.jsonl")).ok()?;
    let done = |step: &StepEvent| match plan.member_budget() {
        Some(budget) => step.seconds.map(|seconds| seconds / budget),
        None => Some(step.step / plan.config.train.iterations as f64),
    };
    let mut reached = false;
    let mut scores = Vec::new();
    for (at, psnr) in events.steps.iter().filter_map(|step| Some((done(step)?, step.psnr?))) {
        reached |= at >= share;
        if at > (1.0 - WINDOW) * share && at <= share {
            scores.push(psnr);
        }
    }
    (reached && !scores.is_empty()).then(|| scores.iter().sum::<f64>() / scores.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Experiment, Selection};

    /// A run of two fields counts both, each by its own share of the budget.
    #[test]
    fn an_ensemble_is_scored_by_all_of_its_fields() {
        let selection = Selection {
            set: vec!["train.ensemble.size=2".into(), "train.iterations=10".into()],
            ..Selection::default()
        };
        let plan = Experiment::plan("fast-losses", &selection).unwrap().runs.remove(0);
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join(plan.directory());
        let log = |member: usize, psnr: f64, steps: usize| {
            let folder = plan.member_folder(&run, member);
            std::fs::create_dir_all(&folder).unwrap();
            let line = |step| format!("{{\"event\":\"step\",\"step\":{step},\"psnr\":{psnr}}}\n");
            std::fs::write(folder.join("metrics.jsonl"), (1..=steps).map(line).collect::<String>()).unwrap();
        };
        log(0, 10.0, 5);
        assert_eq!(score(folder.path(), &plan, 0.5), None, "the second field has not got that far");
        log(1, 20.0, 5);
        assert_eq!(score(folder.path(), &plan, 0.5), Some(15.0));
        assert_eq!(score(folder.path(), &plan, 0.6), None);
    }

    #[test]
    fn rungs_rise_and_leave_one() {
        assert!(rungs(1, 3).is_empty() && rungs(2, 3).is_empty());
        assert_eq!(rungs(3, 3).len(), 1);
        assert_eq!(rungs(9, 3), [1.0 / 9.0, 1.0 / 3.0]);
        assert_eq!(rungs(1000, 2), [0.125, 0.25, 0.5]);
    }
}
