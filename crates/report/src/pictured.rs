//! Choice of the runs whose images and curves are shown.

use std::collections::HashSet;

use crate::{
    Quantity, Record, Run,
    table::{VariantGroup, distinct, groups},
};

/// Maximum number of variants whose images and curves are shown.
pub(crate) const MAX_PICTURED: usize = 12;

/// Variant and preset with their label.
pub(crate) type Labelled<'a> = ((&'a str, &'a str), String);

/// Returns the variants whose images and curves are shown: all, or those with the highest PSNR, in their order.
pub(crate) fn pictured<R: AsRef<Record>>(records: &[R]) -> Vec<Labelled<'_>> {
    let scenes = distinct(records, |record| record.scene.clone());
    let groups = groups(records);
    let psnr =
        |group: &VariantGroup| group.cell(Quantity::PSNR, &scenes).summary.map_or(f64::NEG_INFINITY, |psnr| psnr.mean);
    let mut ranked: Vec<(f64, usize)> = groups.iter().map(psnr).zip(0..).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best: HashSet<usize> = ranked.into_iter().take(MAX_PICTURED).map(|(_, index)| index).collect();
    let chosen = groups.into_iter().enumerate().filter(|(index, _)| best.contains(index));
    chosen.map(|(_, group)| (group.key, group.label)).collect()
}

/// Returns the label of each variant that has runs of `scene`, and its run with the lowest seed.
pub(crate) fn runs_of<'a>(runs: &[&'a Run], variants: &[Labelled], scene: &str) -> (Vec<String>, Vec<&'a Run>) {
    let run = |((variant, preset), label): &Labelled| {
        let same = |Run { record, .. }: &&Run| {
            (record.scene.as_str(), record.variant.as_str(), record.preset.as_str()) == (scene, *variant, *preset)
        };
        Some((label.clone(), runs.iter().copied().filter(same).min_by_key(|run| run.record.seed)?))
    };
    variants.iter().filter_map(run).unzip()
}
