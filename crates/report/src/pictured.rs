//! Which runs have their pictures and curves shown.

use std::collections::HashSet;

use crate::{
    Quantity, Record, ReportInput, Run,
    table::{Group, distinct, groups},
};

/// Variants whose pictures and curves are shown, at most.
pub(crate) const MOST_PICTURED: usize = 12;

/// A variant and preset with its label.
pub(crate) type Labelled<'a> = ((&'a str, &'a str), String);

/// The variants whose pictures and curves are shown: all, or those with the highest PSNR, in their order.
pub(crate) fn pictured(records: &[Record]) -> Vec<Labelled<'_>> {
    let scenes = distinct(records, |record| record.scene.clone());
    let groups = groups(records);
    let psnr = |group: &Group| group.cell(Quantity::PSNR, &scenes).summary.map_or(f64::NEG_INFINITY, |psnr| psnr.mean);
    let mut ranked: Vec<(f64, usize)> = groups.iter().map(psnr).zip(0..).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best: HashSet<usize> = ranked.into_iter().take(MOST_PICTURED).map(|(_, index)| index).collect();
    let chosen = groups.into_iter().enumerate().filter(|(index, _)| best.contains(index));
    chosen.map(|(_, group)| (group.key, group.label)).collect()
}

/// Of each variant that a scene has, its label and the run with the lowest seed.
pub(crate) fn runs_of<'a>(input: &'a ReportInput, variants: &[Labelled], scene: &str) -> (Vec<String>, Vec<&'a Run>) {
    let run = |((variant, preset), label): &Labelled| {
        let same = |Run { record, .. }: &&Run| {
            (record.scene.as_str(), record.variant.as_str(), record.preset.as_str()) == (scene, *variant, *preset)
        };
        Some((label.clone(), input.runs.iter().filter(same).min_by_key(|run| run.record.seed)?))
    };
    variants.iter().filter_map(run).unzip()
}
