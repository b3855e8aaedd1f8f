use std::collections::HashSet;

use indexmap::IndexMap;
use infonerf_metrics::Better;

use super::{Claim, Comparison, Interval, Relation, Side, Verdict};
use crate::{Published, Quantity, Record, table::distinct};

/// A [`Comparison`] with what came of it.
///
/// A pair is both sides of it on one scene with one view set (seed).
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The comparison as a formula, such as `PSNR (dB): entropy > none`.
    pub formula: String,
    /// What stands left of the sign minus what stands right of it: the mean of the pairs' differences, with the interval
    /// that decides.
    pub difference: Option<Interval>,
    /// The same with the interval over scenes like these, where `difference` is of these scenes alone.
    pub alike: Option<Interval>,
    /// Pairs of each scene.
    pub pairs: Vec<usize>,
    /// Whether the seeds of a scene have training views of their own.
    pub view_sets: bool,
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
        let scenes: Vec<Vec<f64>> = pairs.differences.into_values().collect();
        let (these, alike) = (Interval::on_these_scenes(&scenes), Interval::on_scenes_alike(&scenes));
        let single = scenes.first().map(|scene| Interval { mean: scene[0], bounds: None });
        let difference = these.or(alike).or(single);
        let in_paper = published.and_then(|published| {
            let value = |variant: &str| published.value(variant, quantity);
            Some(comparison.difference(comparison.left.value(value)?, comparison.right.value(value)?))
        });
        Self {
            formula: formula(claim, comparison, records),
            difference,
            alike: these.and(alike),
            pairs: scenes.iter().map(Vec::len).collect(),
            view_sets: pairs.view_sets,
            collapsed: pairs.collapsed,
            incomplete: pairs.incomplete,
            published: in_paper,
            verdict: difference.map_or(Verdict::Untested, |interval| verdict(claim, comparison.is, interval)),
            decimals: quantity.decimals(),
        }
    }

    /// What was found, such as `+0.42 [+0.10, +0.74] on these 4 scenes × 5 view sets; +0.42 [-0.31, +1.15] on scenes like
    /// them (mixed model, REML, Satterthwaite)`.
    pub fn found(&self) -> String {
        let (Some(interval), Some(&first)) = (self.difference, self.pairs.first()) else { return "no runs".to_owned() };
        let (scenes, pairs) = (self.pairs.len(), self.pairs.iter().sum());
        let repeat = if self.view_sets { "view set" } else { "seed" };
        let over = if scenes == 1 {
            format!("over {} of one scene", counted(pairs, repeat))
        } else if pairs == scenes {
            format!("over {}", counted(scenes, "scene"))
        } else if self.pairs.iter().all(|&pairs| pairs == first) {
            format!("on these {scenes} scenes × {}", counted(first, repeat))
        } else {
            format!("on these {scenes} scenes, {} in all", counted(pairs, repeat))
        };
        let decimals = self.decimals;
        let alike = self.alike.map_or(String::new(), |alike| {
            format!("; {alike:.decimals$} on scenes like them (mixed model, REML, Satterthwaite)")
        });
        let remark = |count: usize, what: &str| match count {
            0 => String::new(),
            count => format!("; {} {what}", counted(count, "pair")),
        };
        format!(
            "{interval:.decimals$} {over}{alike}{}{}",
            remark(self.collapsed, "with a collapsed run"),
            remark(self.incomplete, "incomplete and left out")
        )
    }

    /// The paper's difference; empty where it gives none.
    pub fn in_paper(&self) -> String {
        let decimals = self.decimals;
        self.published.map_or(String::new(), |difference| format!("{difference:+.decimals$}"))
    }
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// The differences of a comparison on each scene and seed.
struct Pairs {
    differences: IndexMap<String, Vec<f64>>,
    view_sets: bool,
    collapsed: usize,
    incomplete: usize,
}

impl Pairs {
    fn of(comparison: &Comparison, quantity: Quantity, records: &[Record]) -> Self {
        let mut pairs = Self { differences: IndexMap::new(), view_sets: false, collapsed: 0, incomplete: 0 };
        let mut views = HashSet::new();
        for (scene, seed) in distinct(records, |record| (&record.scene, record.seed)) {
            let run =
                |variant: &str| records.iter().find(|r| r.variant == variant && r.scene == *scene && r.seed == seed);
            let value = |variant: &str| quantity.value(run(variant)?);
            match (comparison.left.value(value), comparison.right.value(value)) {
                (Some(left), Some(right)) => {
                    pairs.collapsed += usize::from(comparison.variants().filter_map(run).any(|run| run.collapsed));
                    pairs.differences.entry(scene.clone()).or_default().push(comparison.difference(left, right));
                    views.extend(comparison.variants().find_map(run).map(|run| (scene, &run.train_views)));
                }
                _ => pairs.incomplete += usize::from(comparison.variants().any(|variant| run(variant).is_some())),
            }
        }
        pairs.view_sets = views.len() > pairs.differences.len();
        pairs
    }
}

impl Comparison {
    /// Left minus right, or for *near* |left| − ½ |right|.
    fn difference(&self, left: f64, right: f64) -> f64 {
        if self.is == Relation::Near { left.abs() - 0.5 * right.abs() } else { left - right }
    }
}

fn verdict(claim: &Claim, relation: Relation, difference: Interval) -> Verdict {
    let lower_is_better = claim.metric.better() == Better::Lower;
    let in_favour = match (difference.bounds, relation) {
        (None, _) => return Verdict::Undecided,
        (Some([low, high]), Relation::Near) => [-high, -low],
        (Some([low, high]), _) if lower_is_better => [-high, -low],
        (Some(bounds), _) => bounds,
    };
    let [holds_above, fails_below] = match relation {
        Relation::Better => [0.0, claim.margin],
        Relation::NotWorse => [-claim.margin; 2],
        Relation::Near => [0.0; 2],
    };
    match in_favour {
        [low, _] if low > holds_above => Verdict::Holds,
        [_, high] if high < fails_below => Verdict::Fails,
        _ => Verdict::Undecided,
    }
}

fn formula(claim: &Claim, comparison: &Comparison, records: &[Record]) -> String {
    let lower = claim.metric.better() == Better::Lower;
    let label = |variant: &str| {
        records.iter().find(|record| record.variant == variant).map_or_else(|| variant.to_owned(), Record::label)
    };
    let [left, right] = [&comparison.left, &comparison.right].map(|side| match side {
        Side::Variant(variant) => label(variant),
        Side::Difference([above, below]) => format!("{} − {}", label(above), label(below)),
    });
    let (name, margin) = (claim.metric.name(), claim.margin);
    match (comparison.is, lower) {
        (Relation::Better, false) => format!("{name}: {left} > {right}"),
        (Relation::Better, true) => format!("{name}: {left} < {right}"),
        (Relation::NotWorse, false) => format!("{name}: {left} > {right} − {margin}"),
        (Relation::NotWorse, true) => format!("{name}: {left} < {right} + {margin}"),
        (Relation::Near, _) => format!("{name}: |{left}| ≤ ½ |{right}|"),
    }
}
