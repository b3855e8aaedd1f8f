use infonerf_metrics::Better;

use super::{Claim, Comparison, Interval, Relation, Verdict};
use crate::{Published, Quantity, Record, table::distinct};

/// A [`Comparison`] with what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The comparison as a formula, such as `PSNR (dB): entropy > none`.
    pub formula: String,
    /// What stands left of the sign minus what stands right of it, with its confidence interval.
    pub difference: Option<Interval>,
    /// What the values of `difference` are of.
    pub unit: Unit,
    /// Pairs of which a run collapsed.
    pub collapsed: usize,
    /// Pairs that are left out since a side was not run.
    pub incomplete: usize,
    /// The same difference in the paper, where it gives both sides.
    pub published: Option<f64>,
    /// What they say.
    pub verdict: Verdict,
    decimals: usize,
}

/// What counts as independent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Scenes, each the mean over its seeds.
    Scene,
    /// Seeds of the only scene.
    Seed,
}

impl Finding {
    /// Tests `comparison`, one of `claim`.
    pub(super) fn of(
        claim: &Claim,
        comparison: &Comparison,
        records: &[Record],
        published: Option<&Published>,
    ) -> Self {
        let quantity = claim.metric;
        let pairs = Pairs::of(comparison, quantity, records);
        let (unit, sides) = pairs.sides();
        let sides: Vec<[f64; 2]> = sides.into_iter().map(|sides| comparison.distances(sides)).collect();
        let differences: Vec<f64> = sides.iter().map(|[left, right]| left - right).collect();
        let in_paper = published.and_then(|published| {
            let value = |variant: &str| published.value(variant, quantity);
            Some(comparison.distances([comparison.left.value(value)?, comparison.right.value(value)?]))
        });
        Self {
            formula: formula(claim, comparison),
            difference: Interval::of(&differences),
            unit,
            collapsed: pairs.collapsed,
            incomplete: pairs.incomplete,
            published: in_paper.map(|[left, right]| left - right),
            verdict: verdict(claim, comparison.is, &differences),
            decimals: quantity.decimals(),
        }
    }

    /// What was found, such as `+0.42 [+0.10, +0.74] over 4 scenes`.
    #[must_use]
    pub fn found(&self) -> String {
        let Some(interval) = self.difference else { return "no runs".to_owned() };
        let units = match self.unit {
            Unit::Scene => counted(interval.n, "scene"),
            Unit::Seed => format!("{} of one scene", counted(interval.n, "seed")),
        };
        let remark = |count: usize, what: &str| match count {
            0 => String::new(),
            count => format!("; {} {what}", counted(count, "pair")),
        };
        format!(
            "{interval:.*} over {units}{}{}",
            self.decimals,
            remark(self.collapsed, "with a collapsed run"),
            remark(self.incomplete, "incomplete and left out")
        )
    }

    /// The paper's difference; empty where it gives none.
    #[must_use]
    pub fn in_paper(&self) -> String {
        let decimals = self.decimals;
        self.published.map_or(String::new(), |difference| format!("{difference:+.decimals$}"))
    }
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Both sides of a comparison on each scene and seed.
struct Pairs {
    /// Scene, left and right.
    sides: Vec<(String, [f64; 2])>,
    collapsed: usize,
    incomplete: usize,
}

impl Pairs {
    fn of(comparison: &Comparison, quantity: Quantity, records: &[Record]) -> Self {
        let mut pairs = Self { sides: Vec::new(), collapsed: 0, incomplete: 0 };
        for (scene, seed) in distinct(records, |record| (record.scene.clone(), record.seed)) {
            let run =
                |variant: &str| records.iter().find(|r| r.variant == variant && r.scene == scene && r.seed == seed);
            let value = |variant: &str| quantity.value(run(variant)?);
            match (comparison.left.value(value), comparison.right.value(value)) {
                (Some(left), Some(right)) => {
                    pairs.collapsed += usize::from(comparison.variants().filter_map(run).any(|run| run.collapsed));
                    pairs.sides.push((scene, [left, right]));
                }
                _ => pairs.incomplete += usize::from(comparison.variants().any(|variant| run(variant).is_some())),
            }
        }
        pairs
    }

    /// The mean over the seeds of each scene; or each seed, of a single scene.
    fn sides(&self) -> (Unit, Vec<[f64; 2]>) {
        let mut scenes: Vec<(&str, Vec<[f64; 2]>)> = Vec::new();
        for (scene, sides) in &self.sides {
            match scenes.iter_mut().find(|(name, _)| name == scene) {
                Some((_, own)) => own.push(*sides),
                None => scenes.push((scene, vec![*sides])),
            }
        }
        if let [(_, seeds)] = scenes.as_slice() {
            return (Unit::Seed, seeds.clone());
        }
        let mean =
            |sides: &[[f64; 2]], side: usize| sides.iter().map(|sides| sides[side]).sum::<f64>() / sides.len() as f64;
        (Unit::Scene, scenes.iter().map(|(_, sides)| [mean(sides, 0), mean(sides, 1)]).collect())
    }
}

impl Comparison {
    /// What is compared of left and right: they themselves, or for *near* their distances from zero, half of the right's.
    fn distances(&self, [left, right]: [f64; 2]) -> [f64; 2] {
        if self.is == Relation::Near { [left.abs(), 0.5 * right.abs()] } else { [left, right] }
    }
}

fn verdict(claim: &Claim, relation: Relation, differences: &[f64]) -> Verdict {
    let lower_is_better = claim.metric.better() == Better::Lower;
    let sign = match relation {
        Relation::Near => -1.0,
        Relation::Better | Relation::NotWorse if lower_is_better => -1.0,
        Relation::Better | Relation::NotWorse => 1.0,
    };
    let limit = if relation == Relation::NotWorse { -claim.margin } else { 0.0 };
    let in_favour: Vec<f64> = differences.iter().map(|difference| sign * difference).collect();
    match Interval::of(&in_favour) {
        None => Verdict::Untested,
        Some(Interval { bounds: Some([low, _]), .. }) if low > limit => Verdict::Holds,
        Some(Interval { bounds: Some([_, high]), .. }) if high < limit => Verdict::Fails,
        Some(_) => Verdict::Undecided,
    }
}

fn formula(claim: &Claim, comparison: &Comparison) -> String {
    let lower = claim.metric.better() == Better::Lower;
    let (name, margin, left, right) = (claim.metric.name(), claim.margin, &comparison.left, &comparison.right);
    match (comparison.is, lower) {
        (Relation::Better, false) => format!("{name}: {left} > {right}"),
        (Relation::Better, true) => format!("{name}: {left} < {right}"),
        (Relation::NotWorse, false) => format!("{name}: {left} > {right} − {margin}"),
        (Relation::NotWorse, true) => format!("{name}: {left} < {right} + {margin}"),
        (Relation::Near, _) => format!("{name}: |{left}| ≤ ½ |{right}|"),
    }
}
