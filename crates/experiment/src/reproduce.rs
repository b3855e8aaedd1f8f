//! The paper's tables and figures: which experiments there are, and one report of all.

use std::path::{Path, PathBuf};

use anyhow::Result;
use infonerf_report::{Collection, ReportInput, write_collection};

use crate::sweep::Sweep;
use crate::{Experiment, Selection};

/// What is reproduced, in the order of the report.
pub const EXPERIMENTS: [&str; 11] = [
    "synthetic-4view",
    "paper-regime",
    "loss-ablation",
    "unseen-rays",
    "baseline",
    "views",
    "information",
    "integration",
    "llff-2view",
    "dtu-3view",
    "zju-4view",
];

/// How an experiment becomes one chapter of many: what it runs where nothing else is selected. What is empty is as the
/// experiment has it, as are experiments without a line in [`CHAPTERS`].
struct Chapter {
    experiment: &'static str,
    /// Of photographs, whose formats are not those of the synthetic scenes.
    captures: bool,
    scenes: &'static [&'static str],
    variants: &'static [&'static str],
    seeds: &'static [u64],
    set: &'static [&'static str],
}

impl Chapter {
    const fn whole(experiment: &'static str) -> Self {
        Self { experiment, captures: false, scenes: &[], variants: &[], seeds: &[], set: &[] }
    }

    /// Of the paper's regime, two thirds as long as the experiment alone.
    const fn regime(experiment: &'static str) -> Self {
        Self { set: &["train.iterations=1000", "train.precrop_steps=200"], ..Self::whole(experiment) }
    }

    /// A forward-facing or inward-looking capture, small.
    const fn capture(experiment: &'static str) -> Self {
        Self {
            captures: true,
            variants: &["nerf", "entropy", "kl", "infonerf", "infonerf+"],
            set: &["scene.size=160", "train.iterations=300"],
            ..Self::whole(experiment)
        }
    }
}

const CHAPTERS: [Chapter; 10] = [
    Chapter { variants: &["nerf", "infonerf"], seeds: &[0], ..Chapter::regime("paper-regime") },
    Chapter::regime("loss-ablation"),
    Chapter::regime("unseen-rays"),
    Chapter::regime("baseline"),
    Chapter {
        variants: &["nerf-2", "infonerf-2", "nerf-4", "infonerf-4", "nerf-8", "infonerf-8", "nerf-100", "infonerf-100"],
        ..Chapter::regime("views")
    },
    Chapter::regime("information"),
    Chapter {
        scenes: &["crane", "knot"],
        variants: &["nerf", "infonerf", "mipnerf", "infomipnerf"],
        seeds: &[0],
        ..Chapter::whole("integration")
    },
    Chapter::capture("llff-2view"),
    Chapter::capture("dtu-3view"),
    Chapter { captures: true, set: &["train.iterations=300"], ..Chapter::whole("zju-4view") },
];

fn chapter(experiment: &str) -> Option<&'static Chapter> {
    CHAPTERS.iter().find(|chapter| chapter.experiment == experiment)
}

fn is_of_captures(experiment: &str) -> bool {
    chapter(experiment).is_some_and(|chapter| chapter.captures)
}

/// The sweeps of the experiments called `names`, or of all where that is empty.
///
/// What `selection` says goes before a chapter's own scale. Its data and scenes are those of the synthetic experiments:
/// captures take part in them only where `names` has captures alone, and are the built-in ones otherwise.
///
/// # Errors
/// As [`Experiment::plan`].
pub fn sweeps(names: &[String], selection: &Selection) -> Result<Vec<Sweep>> {
    let wanted = EXPERIMENTS.into_iter().filter(|&name| names.is_empty() || names.iter().any(|only| only == name));
    let captures_alone = !names.is_empty() && names.iter().all(|name| is_of_captures(name));
    let sweep = |name: &str| {
        let mut selection = selection.clone();
        if is_of_captures(name) && !captures_alone {
            (selection.data, selection.scenes) = (None, Vec::new());
        }
        Ok(Sweep::of(Experiment::plan(name, &scaled(name, selection))?))
    };
    wanted.map(sweep).collect()
}

/// `selection` with what it leaves open as the chapter has it.
fn scaled(experiment: &str, selection: Selection) -> Selection {
    let Some(chapter) = chapter(experiment) else { return selection };
    let owned = |list: &[&str]| list.iter().map(|&text| text.to_owned()).collect::<Vec<String>>();
    let or = |given: Vec<String>, own: &[&str]| if given.is_empty() { owned(own) } else { given };
    Selection {
        scenes: if selection.data.is_some() { selection.scenes } else { or(selection.scenes, chapter.scenes) },
        variants: or(selection.variants, chapter.variants),
        seeds: if selection.seeds.is_empty() { chapter.seeds.to_vec() } else { selection.seeds },
        set: [owned(chapter.set), selection.set].concat(),
        ..selection
    }
}

/// Writes the report of all experiments into `out`, and returns the page.
///
/// # Errors
/// If a file cannot be written.
pub fn write(inputs: Vec<ReportInput>, out: &Path) -> Result<PathBuf> {
    let chapter = |input: ReportInput| infonerf_report::Chapter { folder: input.experiment.clone(), input };
    let collection = Collection {
        title: "InfoNeRF's tables and figures, at a small scale".into(),
        introduction: vec![
            "The paper's tables and figures at a scale that suits a small machine, its own figures beside ours. The first \
             is of this program's fast field, those up to the integration are of the paper's regime on small networks \
             and in runs two thirds as long as the experiments' own, and the captures are built-in twins of LLFF, DTU and ZJU-MoCap unless their data was given. Footnotes name every difference of \
             protocol: the absolute figures are not comparable, the order of the variants is."
                .into(),
        ],
        chapters: inputs.into_iter().map(chapter).collect(),
    };
    Ok(write_collection(&collection, out)?.html)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RunPlan;

    fn labels(names: &[&str], selection: &Selection) -> Vec<String> {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let sweeps = sweeps(&names, selection).unwrap();
        sweeps.iter().flat_map(|sweep| sweep.runs().map(RunPlan::label)).collect()
    }

    #[test]
    fn what_is_selected_goes_before_a_chapters_scale() {
        assert_eq!(labels(&["paper-regime"], &Selection::default()).len(), 8);
        let one = Selection { scenes: vec!["orrery".into()], seeds: vec![3], ..Selection::default() };
        let found = labels(&["paper-regime", "zju-4view"], &one);
        assert_eq!(found.iter().filter(|label| label.contains("orrery")).count(), 2, "{found:?}");
        // The figure, not the orrery, which is no capture.
        assert!(found.iter().any(|label| label.contains("figure")), "{found:?}");
    }

    #[test]
    fn every_experiment_takes_part() {
        let all = sweeps(&[], &Selection::default()).unwrap();
        let names: Vec<&str> = all.iter().map(|sweep| sweep.about.name.as_str()).collect();
        assert_eq!(names, EXPERIMENTS);
        assert!(CHAPTERS.iter().all(|chapter| EXPERIMENTS.contains(&chapter.experiment)));
        // Of a small capture every run is small.
        let capture = &all[8];
        assert!(capture.runs().all(|plan| plan.config.scene.size == 160 && plan.config.train.iterations == 300));
        assert_eq!(capture.len(), 5);
    }
}
