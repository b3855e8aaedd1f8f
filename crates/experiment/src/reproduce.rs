//! The paper's tables and figures: which experiments there are, and one report of all.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use infonerf_report::{Collection, ReportInput, write_collection};

use crate::sweep::Sweep;
use crate::{Experiment, Selection};

/// How an experiment becomes one chapter of many: what it runs where nothing else is selected. What is empty is as the
/// experiment has it.
struct Scale {
    experiment: &'static str,
    /// Of photographs, whose formats are not those of the synthetic scenes.
    captures: bool,
    scenes: &'static [&'static str],
    variants: &'static [&'static str],
    seeds: &'static [u64],
    set: &'static [&'static str],
}

impl Scale {
    const fn whole(experiment: &'static str) -> Self {
        Self { experiment, captures: false, scenes: &[], variants: &[], seeds: &[], set: &[] }
    }

    /// Of the paper's regime, about half as long as the experiment alone.
    const fn regime(experiment: &'static str) -> Self {
        Self { set: &["train.iterations=720", "train.precrop_steps=144"], ..Self::whole(experiment) }
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

/// What is reproduced, in the order of the report.
const SCALES: [Scale; 11] = [
    Scale::whole("synthetic-4view"),
    Scale { variants: &["nerf", "infonerf"], seeds: &[0], ..Scale::regime("paper-regime") },
    Scale::regime("loss-ablation"),
    Scale::regime("unseen-rays"),
    Scale::regime("baseline"),
    Scale {
        variants: &["nerf-2", "infonerf-2", "nerf-4", "infonerf-4", "nerf-8", "infonerf-8", "nerf-100", "infonerf-100"],
        ..Scale::regime("views")
    },
    Scale::regime("information"),
    Scale {
        scenes: &["crane", "knot"],
        variants: &["nerf", "infonerf", "mipnerf", "infomipnerf"],
        seeds: &[0],
        ..Scale::whole("integration")
    },
    Scale::capture("llff-2view"),
    Scale::capture("dtu-3view"),
    Scale { captures: true, set: &["train.iterations=300"], ..Scale::whole("zju-4view") },
];

/// The experiments, in the order of the report.
pub const EXPERIMENTS: [&str; SCALES.len()] = {
    let mut names = [""; SCALES.len()];
    let mut index = 0;
    while index < names.len() {
        names[index] = SCALES[index].experiment;
        index += 1;
    }
    names
};

/// The sweeps of the experiments called `names`, or of all where that is empty.
///
/// What `selection` says goes before an experiment's own scale. Its data and scenes are those of the synthetic experiments:
/// captures take part in them only where `names` has captures alone, and are the built-in ones otherwise.
///
/// # Errors
/// If a name is not one of [`EXPERIMENTS`], and as [`Experiment::plan`].
pub fn sweeps(names: &[String], selection: &Selection) -> Result<Vec<Sweep>> {
    if let Some(unknown) = names.iter().find(|name| !EXPERIMENTS.contains(&name.as_str())) {
        bail!("{unknown}: expected one of {}", EXPERIMENTS.join(", "));
    }
    let named = |scale: &&Scale| names.iter().any(|name| name == scale.experiment);
    let captures_alone = !names.is_empty() && SCALES.iter().filter(named).all(|scale| scale.captures);
    let sweep = |scale: &Scale| {
        let mut selection = selection.clone();
        if scale.captures && !captures_alone {
            (selection.data, selection.scenes) = (None, Vec::new());
        }
        Ok(Sweep::of(Experiment::plan(scale.experiment, &scaled(scale, selection))?))
    };
    SCALES.iter().filter(|scale| names.is_empty() || named(scale)).map(sweep).collect()
}

/// `selection` with what it leaves open as `scale` has it.
fn scaled(scale: &Scale, selection: Selection) -> Selection {
    let owned = |list: &[&str]| list.iter().map(|&text| text.to_owned()).collect::<Vec<String>>();
    let or = |given: Vec<String>, own: &[&str]| if given.is_empty() { owned(own) } else { given };
    Selection {
        scenes: if selection.data.is_some() { selection.scenes } else { or(selection.scenes, scale.scenes) },
        variants: or(selection.variants, scale.variants),
        seeds: if selection.seeds.is_empty() { scale.seeds.to_vec() } else { selection.seeds },
        set: [owned(scale.set), selection.set].concat(),
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
             is of this program's fast field. Those before the integration are of the paper's regime on small networks, \
             in runs about half as long as the experiments' own. The captures are built-in twins of LLFF, DTU and \
             ZJU-MoCap unless their data was given. Footnotes name every difference of protocol: the absolute figures \
             are not comparable, the order of the variants is."
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
        assert!(sweeps(&["nothing".into()], &Selection::default()).is_err());
        // Of a small capture every run is small.
        let capture = &all[8];
        assert!(capture.runs().all(|plan| plan.config.scene.size == 160 && plan.config.train.iterations == 300));
        assert_eq!(capture.len(), 5);
    }
}
