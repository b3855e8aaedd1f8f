//! The paper's tables and figures: which experiments there are, and one report of all.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use infonerf_report::{ReportInput, write_collection};

use crate::plan::{Experiment, Selection};
use crate::sweep::Sweep;

/// Chapter of the report: an experiment, and its default runs. An empty field leaves the experiment's own value.
struct Chapter {
    experiment: &'static str,
    /// Whether the scenes are captures (photographs), whose formats differ from those of the synthetic scenes.
    captures: bool,
    variants: &'static [&'static str],
    set: &'static [&'static str],
    small: ChapterExtent,
    full: ChapterExtent,
}

/// Scenes and seeds of a chapter; each seed has a set of training views.
#[derive(Clone, Copy)]
struct ChapterExtent {
    scenes: &'static [&'static str],
    seeds: &'static [u64],
}

/// Extent of the experiment itself.
const OWN: ChapterExtent = ChapterExtent { scenes: &[], seeds: &[] };
/// Extent of chapters with many variants, with which all chapters together take about an hour.
const TWO_BY_TWO: ChapterExtent = ChapterExtent { scenes: &["crane", "knot"], seeds: &[0, 1] };
/// Extent that testing the claims needs: four scenes and five sets of training views.
const FOUR_BY_FIVE: ChapterExtent =
    ChapterExtent { scenes: &["castle", "crane", "knot", "orrery"], seeds: &[0, 1, 2, 3, 4] };

const fn chapter(experiment: &'static str, small: ChapterExtent) -> Chapter {
    Chapter { experiment, captures: false, variants: &[], set: &[], small, full: FOUR_BY_FIVE }
}

/// Returns a chapter on a small capture, forward-facing or inward-looking.
const fn capture(experiment: &'static str, variants: &'static [&'static str], set: &'static [&'static str]) -> Chapter {
    let full = ChapterExtent { scenes: &[], ..FOUR_BY_FIVE };
    Chapter { experiment, captures: true, variants, set, small: OWN, full }
}

/// Variants of the chapters on captures. `SMALL` has the settings of these chapters.
const CAPTURE: &[&str] = &["factored", "entropy", "kl", "infonerf", "infonerf+"];
const SMALL: &[&str] = &["scene.size=160", "train.iterations=300"];

const CHAPTERS: [Chapter; 11] = [
    chapter("synthetic-4view", OWN),
    chapter("fast-losses", ChapterExtent { seeds: &[0], ..FOUR_BY_FIVE }),
    chapter("loss-ablation", ChapterExtent { seeds: &[0, 1], ..FOUR_BY_FIVE }),
    chapter("unseen-rays", TWO_BY_TWO),
    chapter("baseline", TWO_BY_TWO),
    Chapter {
        variants: &["nerf-2", "infonerf-2", "nerf-4", "infonerf-4", "nerf-8", "infonerf-8", "nerf-100", "infonerf-100"],
        ..chapter("views", TWO_BY_TWO)
    },
    chapter("information", TWO_BY_TWO),
    Chapter {
        variants: &["nerf", "infonerf", "mipnerf", "infomipnerf"],
        ..chapter("integration", ChapterExtent { seeds: &[0], ..TWO_BY_TWO })
    },
    capture("llff-2view", CAPTURE, SMALL),
    capture("dtu-3view", CAPTURE, SMALL),
    capture("zju-4view", &[], &["train.iterations=300"]),
];

/// Returns the experiments, in the order of the report.
pub fn experiments() -> [&'static str; CHAPTERS.len()] {
    CHAPTERS.map(|chapter| chapter.experiment)
}

/// Returns the sweeps of the experiments called `names`, or of all experiments if `names` is empty. They take an hour on two
/// cores. With `full` they have four scenes and five view sets for every claim of the paper's regime, and take a night.
///
/// Settings in `selection` take precedence over a chapter's own extent. Data and scenes of `selection` apply to captures only
/// if all of `names` are captures. Otherwise they apply to the synthetic experiments alone; captures use built-in scenes.
///
/// # Errors
/// If a name is not one of [`experiments`], and as [`Experiment::plan`].
pub fn sweeps(names: &[String], full: bool, selection: &Selection) -> Result<Vec<Sweep>> {
    if let Some(unknown) = names.iter().find(|name| !experiments().contains(&name.as_str())) {
        bail!("{unknown}: expected one of {}", experiments().join(", "));
    }
    let named = |chapter: &&Chapter| names.iter().any(|name| name == chapter.experiment);
    let captures_alone = !names.is_empty() && CHAPTERS.iter().filter(named).all(|chapter| chapter.captures);
    let sweep = |chapter: &Chapter| {
        let mut selection = selection.clone();
        if chapter.captures && !captures_alone {
            (selection.data, selection.scenes) = (None, Vec::new());
        }
        Ok(Sweep::from(Experiment::plan(chapter.experiment, &extended(chapter, full, selection))?))
    };
    CHAPTERS.iter().filter(|chapter| names.is_empty() || named(chapter)).map(sweep).collect()
}

/// Returns `selection`, with whatever it leaves open taken from `chapter`.
fn extended(chapter: &Chapter, full: bool, selection: Selection) -> Selection {
    let extent = if full { chapter.full } else { chapter.small };
    let owned = |list: &[&str]| list.iter().map(|&text| text.to_owned()).collect::<Vec<String>>();
    let or = |given: Vec<String>, own: &[&str]| if given.is_empty() { owned(own) } else { given };
    Selection {
        scenes: if selection.data.is_some() { selection.scenes } else { or(selection.scenes, extent.scenes) },
        variants: or(selection.variants, chapter.variants),
        seeds: if selection.seeds.is_empty() { extent.seeds.to_vec() } else { selection.seeds },
        set: [owned(chapter.set), selection.set].concat(),
        ..selection
    }
}

/// Writes the report of all experiments into `out`, and returns the page.
pub fn write(inputs: &[ReportInput], out: &Path) -> Result<PathBuf> {
    let title = "InfoNeRF's tables and figures, at a small scale";
    let introduction = "The paper's tables and figures at a scale that suits a small machine, its own figures next to ours: the released \
         code's regime on small networks and small images, but for the chapter of this program's fast field. The captures \
         are built-in twins of LLFF, DTU and ZJU-MoCap unless their data was given. Footnotes name every difference of \
         protocol: the absolute figures are not comparable, the order of the variants is.";
    Ok(write_collection(title, introduction, inputs, out)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::selected;

    #[test]
    fn every_experiment_takes_part() {
        let all = sweeps(&[], false, &Selection::default()).unwrap();
        let names: Vec<&str> = all.iter().map(|sweep| sweep.about.name.as_str()).collect();
        assert_eq!(names, experiments());
        assert!(sweeps(&["nothing".into()], false, &Selection::default()).is_err());
        let runs = |sweeps: &[Sweep]| sweeps.iter().map(|sweep| sweep.runs().len()).sum::<usize>();
        assert!(runs(&sweeps(&[], true, &Selection::default()).unwrap()) > 2 * runs(&all));
        let selection = selected(&["orrery"], &[], &[]);
        let mixed = sweeps(&["synthetic-4view".into(), "zju-4view".into()], false, &selection).unwrap();
        assert!(mixed[0].runs().all(|plan| plan.scene == "orrery"));
        assert!(mixed[1].runs().all(|plan| plan.scene == "figure"), "the figure, not the orrery, which is no capture");
        // Every run of a capture has the settings `SMALL`.
        let capture = &all[8];
        assert!(capture.runs().all(|plan| plan.config.scene.size == 160 && plan.config.train.iterations == 300));
        assert_eq!((capture.runs().len(), all[1].runs().len()), (5, 16));
    }
}
