//! Whether the best setting of a grid is significantly better than its neighbours.

use std::collections::HashMap;

use infonerf_report::{Claim, Comparison, Quantity, Record, Relation, Side};

use super::figures::{Means, means, variants};
use super::grid::Grid;
use super::{Sweep, assignments};

/// Returns a claim for each variant: the setting with the highest mean PSNR is better than each of its neighbours,
/// whose value of one key is the next lower or higher one. Like every [`Claim`] it is tested on differences within a
/// scene and seed. The setting was chosen on the very runs that test it, so its lead is overestimated, and the
/// statement says so.
///
/// Nothing if values have no order: grids of other things than numbers.
pub(super) fn claims(sweep: &Sweep, records: &[Record]) -> Vec<Claim> {
    let Some(ranks) = sweep.grids.iter().map(ranks).collect::<Option<Vec<_>>>() else { return Vec::new() };
    if ranks.is_empty() {
        return Vec::new();
    }
    let means = means(records);
    variants(sweep).iter().filter_map(|variant| claim(sweep, variant, &ranks, &means)).collect()
}

/// Returns the rank of each value, which is how many are smaller; `None` unless all are numbers.
fn ranks(grid: &Grid) -> Option<Vec<usize>> {
    let numbers = (0..grid.values.len()).map(|index| grid.number(index)).collect::<Option<Vec<f64>>>()?;
    Some(numbers.iter().map(|number| numbers.iter().filter(|other| *other < number).count()).collect())
}

fn claim(sweep: &Sweep, variant: &str, ranks: &[Vec<usize>], means: &Means) -> Option<Claim> {
    // The name and mean of each choice of values.
    let own = sweep.items.iter().filter(|item| item.variant == variant);
    let settings: HashMap<&[usize], (&str, f64)> = own
        .filter_map(|item| {
            let name = item.plan.variant.as_str();
            Some((&item.choice[..], (name, *means.get(name)?)))
        })
        .collect();
    let (best, (name, _)) = settings.iter().max_by(|a, b| a.1.1.total_cmp(&b.1.1).then_with(|| b.0.cmp(a.0)))?;
    let steps = |choice: &[usize]| -> usize {
        let places = ranks.iter().zip(best.iter().zip(choice));
        places.map(|(ranks, (&a, &b))| ranks[a].abs_diff(ranks[b])).sum()
    };
    let mut neighbours: Vec<_> = settings.iter().filter(|(choice, _)| steps(choice) == 1).collect();
    neighbours.sort_by_key(|(choice, _)| **choice);
    let comparison = |(_, (other, _)): &(&&[usize], &(&str, f64))| Comparison {
        left: Side::Variant((*name).to_owned()),
        is: Relation::Better,
        right: Side::Variant((*other).to_owned()),
    };
    let comparisons: Vec<Comparison> = neighbours.iter().map(comparison).collect();
    let statement = format!(
        "{variant}: the best setting, {}, is better than its neighbours (chosen on these very runs, which flatters it)",
        assignments(&sweep.grids, best).join(" ")
    );
    let claim = Claim { statement, metric: Quantity::PSNR, margin: 0.0, comparisons };
    (!claim.comparisons.is_empty()).then_some(claim)
}

#[cfg(test)]
mod tests {
    use infonerf_report::Verdict;

    use super::super::Item;
    use super::*;
    use crate::Selection;

    #[test]
    fn the_best_is_compared_with_its_neighbours() {
        let selection = Selection {
            scenes: vec!["knot".into(), "crane".into(), "castle".into()],
            variants: vec!["infonerf".into()],
            ..Selection::default()
        };
        let grids = ["loss.entropy.weight=1e-3,0,1e-2,1e-4", "loss.kl.weight=0,1e-5"].map(str::to_owned).to_vec();
        let sweep = Sweep::plan("fast-losses", &grids, &selection).unwrap();
        let psnr = |scene: &str, choice: &[usize]| {
            // The second best is better than the best on one scene.
            let noise = if choice[0] == 2 && scene == "knot" { 0.2 } else { 0.0 };
            [20.0, 14.0, 19.9, 16.0][choice[0]] - 0.5 * choice[1] as f64 + noise
        };
        let record = |item: &Item| Record {
            scene: item.plan.scene.clone(),
            variant: item.plan.variant.clone(),
            metrics: [("psnr".to_owned(), Some(psnr(&item.plan.scene, &item.choice)))].into_iter().collect(),
            ..Record::default()
        };
        let records: Vec<Record> = sweep.items.iter().map(record).collect();
        let claims = claims(&sweep, &records);
        assert_eq!(claims.len(), 1);
        assert!(claims[0].statement.contains("loss.entropy.weight=1e-3 loss.kl.weight=0,"), "{}", claims[0].statement);
        // λ₁ one lower and one higher, in whatever order they were written, and λ₂ one higher.
        assert_eq!(claims[0].comparisons.len(), 3);
        let tested = claims[0].test(&records, None);
        let count = |verdict| tested.findings.iter().filter(|finding| finding.verdict == verdict).count();
        assert_eq!((count(Verdict::Holds), count(Verdict::Undecided)), (2, 1), "{tested:?}");
    }
}
