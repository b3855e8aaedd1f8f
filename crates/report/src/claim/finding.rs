use std::collections::HashSet;

use indexmap::IndexMap;
use infonerf_metrics::Better;

use super::{Claim, Comparison, Interval, Relation, Side, Verdict};
use crate::{Published, Quantity, Record, table::distinct};

/// Result of a [`Comparison`].
///
/// A pair is both of its sides on one scene with one view set (seed).
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Formula of the comparison, such as `PSNR (dB): entropy > none`.
    pub formula: String,
    /// Left side minus right side, as the mean over pairs, with the interval that decides; for *near* the excess
    /// |left| − ½ |right| of the means.
    pub difference: Option<Interval>,
    /// Mean difference with the interval over scenes like these, if `difference` is of these scenes alone.
    pub alike: Option<Interval>,
    /// Pairs of each scene.
    pub pairs: Vec<usize>,
    /// Whether the seeds of a scene have training views of their own.
    pub view_sets: bool,
    /// Pairs of which a run collapsed.
    pub collapsed: usize,
    /// Pairs that are left out since a side was not run.
    pub incomplete: usize,
    /// Difference in the paper; `None` if it lacks a side.
    pub published: Option<f64>,
    /// Verdict of `difference`.
    pub verdict: Verdict,
    decimals: usize,
}

impl Finding {
    /// Tests `comparison`, one of `claim`.
    pub(super) fn of<R: AsRef<Record>>(
        claim: &Claim,
        comparison: &Comparison,
        records: &[R],
        published: Option<&Published>,
    ) -> Self {
        let quantity = claim.metric;
        let pairs = Pairs::of(comparison, quantity, records);
        let scenes = differences(comparison.is, pairs.sides.into_values().collect());
        let (these, alike) = (Interval::on_these_scenes(&scenes), Interval::on_scenes_alike(&scenes));
        let single = scenes.first().map(|scene| Interval { mean: scene[0], bounds: None });
        let difference = these.or(alike).or(single);
        let in_paper = published.and_then(|published| {
            let value = |variant: &str| published.value(variant, quantity).map(|value| compared(quantity, value));
            let sides = [comparison.left.value(value)?, comparison.right.value(value)?];
            Some(differences(comparison.is, vec![vec![sides]])[0][0])
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

    /// Describes the difference, such as `+0.42 [+0.10, +0.74] on these 4 scenes × 5 view sets; +0.42 [-0.31, +1.15] on
    /// scenes like them (mixed model, REML, Satterthwaite)`.
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

    /// Formats the paper's difference; empty if it has none.
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
    sides: IndexMap<String, Vec<[f64; 2]>>,
    view_sets: bool,
    collapsed: usize,
    incomplete: usize,
}

impl Pairs {
    fn of<R: AsRef<Record>>(comparison: &Comparison, quantity: Quantity, records: &[R]) -> Self {
        let mut pairs = Self { sides: IndexMap::new(), view_sets: false, collapsed: 0, incomplete: 0 };
        let mut views = HashSet::new();
        for (scene, seed) in distinct(records, |record| (&record.scene, record.seed)) {
            let own = |record: &&Record| record.scene == *scene && record.seed == seed;
            let run =
                |variant: &str| records.iter().map(AsRef::as_ref).filter(own).find(|record| record.variant == variant);
            let value = |variant: &str| Some(compared(quantity, quantity.value(run(variant)?)?));
            match (comparison.left.value(value), comparison.right.value(value)) {
                (Some(left), Some(right)) => {
                    pairs.collapsed += usize::from(comparison.variants().filter_map(run).any(|run| run.collapsed));
                    pairs.sides.entry(scene.clone()).or_default().push([left, right]);
                    views.extend(comparison.variants().find_map(run).map(|run| (scene, &run.train_views)));
                }
                _ => pairs.incomplete += usize::from(comparison.variants().any(|variant| run(variant).is_some())),
            }
        }
        pairs.view_sets = views.len() > pairs.sides.len();
        pairs
    }
}

/// Maps the value of a quantity that is best at 1 to its distance from 1, of which less is better; keeps any other.
fn compared(quantity: Quantity, value: f64) -> f64 {
    if quantity.better() == Better::NearOne { (value - 1.0).abs() } else { value }
}

/// Returns left minus right of each scene's pairs; for *near* `|left| − ½ |right|` with the signs of the sides' means.
/// A sign for each pair would take noise about 0 for a distance.
fn differences(relation: Relation, scenes: Vec<Vec<[f64; 2]>>) -> Vec<Vec<f64>> {
    let mean = |side: usize| {
        let of_scene = |pairs: &Vec<[f64; 2]>| pairs.iter().map(|pair| pair[side]).sum::<f64>() / pairs.len() as f64;
        scenes.iter().map(of_scene).sum::<f64>()
    };
    let [left, right] = match relation {
        Relation::Near => [mean(0).signum(), 0.5 * mean(1).signum()],
        Relation::Better | Relation::NotWorse => [1.0; 2],
    };
    scenes.iter().map(|pairs| pairs.iter().map(|[l, r]| left * l - right * r).collect()).collect()
}

fn verdict(claim: &Claim, relation: Relation, difference: Interval) -> Verdict {
    let lower_is_better = claim.metric.better() != Better::Higher;
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

fn formula<R: AsRef<Record>>(claim: &Claim, comparison: &Comparison, records: &[R]) -> String {
    let better = claim.metric.better();
    let label = |variant: &str| {
        let mut all = records.iter().map(AsRef::as_ref);
        all.find(|record| record.variant == variant).map_or_else(|| variant.to_owned(), Record::label)
    };
    let [left, right] = [&comparison.left, &comparison.right].map(|side| match side {
        Side::Variant(variant) => label(variant),
        Side::Difference([above, below]) => format!("{} − {}", label(above), label(below)),
    });
    let (name, margin) = (claim.metric.name(), claim.margin);
    let name = if better == Better::NearOne { format!("|{name} − 1|") } else { name };
    match (comparison.is, better != Better::Higher) {
        (Relation::Better, false) => format!("{name}: {left} > {right}"),
        (Relation::Better, true) => format!("{name}: {left} < {right}"),
        (Relation::NotWorse, false) => format!("{name}: {left} > {right} − {margin}"),
        (Relation::NotWorse, true) => format!("{name}: {left} < {right} + {margin}"),
        (Relation::Near, _) => format!("{name}: |{left}| ≤ ½ |{right}|"),
    }
}
