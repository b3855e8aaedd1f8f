//! Whether the best setting of a grid is better than those beside it, or a peak of noise.

use infonerf_report::{Claim, Comparison, Quantity, Record, Relation, Side, overview_table};

use super::figures::variants;
use super::plan::Sweep;

/// For each variant a claim: the setting with the highest mean PSNR is better than each of its neighbours, which differ by
/// one step of one grid. Like every [`Claim`] it is tested on differences within a scene and seed. The setting was chosen
/// on the very runs that test it, so its lead is overestimated, and the statement says so.
///
/// Nothing for random settings, which have no neighbours.
pub(super) fn claims(sweep: &Sweep, records: &[Record]) -> Vec<Claim> {
    if !sweep.space.ranges.is_empty() {
        return Vec::new();
    }
    variants(sweep).iter().filter_map(|variant| claim(sweep, variant, records)).collect()
}

fn claim(sweep: &Sweep, variant: &str, records: &[Record]) -> Option<Claim> {
    let table = overview_table(records, &[Quantity::PSNR]);
    let mean = |label: &str| table.rows.iter().find(|row| row.label == label)?.cells.first()?.summary.map(|s| s.mean);
    let mut settings: Vec<(&[usize], &str, f64)> = Vec::new();
    for item in sweep.items.iter().filter(|item| item.variant == variant) {
        if !settings.iter().any(|(choice, ..)| *choice == item.setting.choice) {
            let label = item.plan.variant.as_str();
            settings.extend(mean(label).map(|psnr| (&item.setting.choice[..], label, psnr)));
        }
    }
    let (best, label, _) = *settings.iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
    let steps = |choice: &[usize]| best.iter().zip(choice).map(|(a, b)| a.abs_diff(*b)).sum::<usize>();
    let beside = settings.iter().filter(|(choice, ..)| steps(choice) == 1);
    let comparisons: Vec<Comparison> = beside
        .map(|(_, other, _)| Comparison {
            left: Side::Variant(label.to_owned()),
            is: Relation::Better,
            right: Side::Variant((*other).to_owned()),
        })
        .collect();
    let values: Vec<String> = sweep.space.grids.iter().zip(best).map(|(grid, &index)| grid.assignment(index)).collect();
    let statement = format!(
        "{variant}: the best setting, {}, is better than those beside it (chosen on these very runs, which flatters it)",
        values.join(" ")
    );
    let claim = Claim { statement, metric: Quantity::PSNR, margin: 0.0, comparisons };
    (!claim.comparisons.is_empty()).then_some(claim)
}

#[cfg(test)]
mod tests {
    use infonerf_report::Verdict;

    use super::super::{Item, Sweep, SweepOptions};
    use super::*;
    use crate::Selection;

    #[test]
    fn the_best_is_compared_with_its_neighbours() {
        let selection = Selection {
            scenes: vec!["knot".into(), "crane".into(), "castle".into()],
            variants: vec!["infonerf".into()],
            ..Selection::default()
        };
        let grids = ["loss.entropy.weight=0,1e-4,1e-3,1e-2", "loss.kl.weight=0,1e-5"].map(str::to_owned).to_vec();
        let sweep =
            Sweep::plan("synthetic-4view", &SweepOptions { grids, selection, ..SweepOptions::default() }).unwrap();
        let psnr = |scene: &str, choice: &[usize]| {
            // The second best is better than the best on one scene.
            let noise = if choice[0] == 3 && scene == "knot" { 0.2 } else { 0.0 };
            [14.0, 16.0, 20.0, 19.9][choice[0]] - 0.5 * choice[1] as f64 + noise
        };
        let record = |item: &Item| Record {
            scene: item.plan.scene.clone(),
            variant: item.plan.variant.clone(),
            metrics: [("psnr".to_owned(), Some(psnr(&item.plan.scene, &item.setting.choice)))].into_iter().collect(),
            ..Record::default()
        };
        let records: Vec<Record> = sweep.items.iter().map(record).collect();
        let claims = claims(&sweep, &records);
        assert_eq!(claims.len(), 1);
        assert!(claims[0].statement.contains("loss.entropy.weight=1e-3 loss.kl.weight=0,"), "{}", claims[0].statement);
        // One step down and up of λ₁, one up of λ₂.
        assert_eq!(claims[0].comparisons.len(), 3);
        let tested = claims[0].test(&records, None);
        let count = |verdict| tested.findings.iter().filter(|finding| finding.verdict == verdict).count();
        assert_eq!((count(Verdict::Holds), count(Verdict::Undecided)), (2, 1), "{tested:?}");
    }
}
