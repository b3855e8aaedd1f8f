//! The paper's tables and figures: which experiments there are, and one report of all.

use std::path::{Path, PathBuf};

use anyhow::Result;
use infonerf_report::{Chapter, Collection, ReportInput, write_collection};

use crate::sweep::Sweep;
use crate::{Experiment, Selection};

/// What is reproduced, in the order of the report.
pub const EXPERIMENTS: [&str; 6] =
    ["synthetic-4view", "loss-ablation", "unseen-rays", "baseline", "views", "information"];

/// The sweeps of the experiments called `names`, or of all where that is empty.
///
/// # Errors
/// As [`Experiment::plan`].
pub fn sweeps(names: &[String], selection: &Selection) -> Result<Vec<Sweep>> {
    let wanted = EXPERIMENTS.into_iter().filter(|&name| names.is_empty() || names.iter().any(|only| only == name));
    wanted.map(|name| Ok(Sweep::of(Experiment::plan(name, selection)?))).collect()
}

/// Writes the report of all experiments into `out`, and returns the page.
///
/// # Errors
/// If a file cannot be written.
pub fn write(inputs: Vec<ReportInput>, out: &Path) -> Result<PathBuf> {
    let chapter = |input: ReportInput| Chapter { folder: input.experiment.clone(), input };
    let collection = Collection {
        title: "InfoNeRF's synthetic tables and figures, at a small scale".into(),
        introduction: vec![
            "Each synthetic table and figure of the paper at a scale that suits a small machine, the paper's own figures \
             beside ours. Footnotes name every difference of protocol: the absolute figures are not comparable, the order \
             of the variants is."
                .into(),
        ],
        chapters: inputs.into_iter().map(chapter).collect(),
    };
    Ok(write_collection(&collection, out)?.html)
}
