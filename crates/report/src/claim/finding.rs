//! Findings of comparisons: pairs of runs, their difference, and the verdict.

use std::collections::HashSet;
use std::fmt;

use indexmap::IndexMap;
use infonerf_metrics::Better;

use super::{Claim, Comparison, Relation, Side};
use crate::interval::Interval;
use crate::published::Published;
use crate::quantity::Quantity;
use crate::record::{Record, distinct};
use crate::text::counted;

/// Outcome of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// The claim holds.
    Holds,
    /// The difference is within the noise.
    Undecided,
    /// No runs have both sides.
    Untested,
    /// The claim does not hold.
    Fails,
}

impl Verdict {
    /// Returns the CSS class of the verdict's mark on a page.
    pub(crate) fn class(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Fails => "fails",
            Self::Undecided | Self::Untested => "open",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Holds => "holds",
            Self::Undecided => "undecided",
            Self::Untested => "not tested",
            Self::Fails => "does not hold",
        })
    }
}

/// Result of a [`Comparison`]. A pair has both sides of the comparison on one scene with one view set (seed).
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Formula of the comparison, such as `PSNR (dB): entropy > none`.
    pub formula: String,
    /// Mean over pairs of left minus right (for *near*, of |left| − ½ |right|) with the interval that decides, then with the
    /// interval over scenes like these, such as `+0.42 [+0.10, +0.74] on these 4 scenes × 5 view sets; +0.42 [-0.31, +1.15] on
    /// scenes like them (mixed model, REML, Satterthwaite)`.
    pub found: String,
    /// Difference in the paper; empty if the paper lacks a side.
    pub in_paper: String,
    /// Verdict of the difference found.
    pub verdict: Verdict,
}

impl Finding {
    pub(super) fn of(claim: &Claim, comparison: &Comparison, records: &[Record], paper: Option<&Published>) -> Self {
        let quantity = claim.metric;
        // Both sides of each pair, by scene.
        let mut sides: IndexMap<&String, Vec<[f64; 2]>> = IndexMap::new();
        let (mut views, mut collapsed, mut incomplete) = (HashSet::new(), 0, 0);
        for (scene, seed) in distinct(records, |record| (&record.scene, record.seed)) {
            let own = |record: &&Record| record.scene == *scene && record.seed == seed;
            let run = |variant: &str| records.iter().filter(own).find(|record| record.variant == variant);
            let value = |variant: &str| Some(compared(quantity, quantity.value(run(variant)?)?));
            match (comparison.left.value(value), comparison.right.value(value)) {
                (Some(left), Some(right)) => {
                    collapsed += usize::from(comparison.variants().filter_map(run).any(|run| run.collapsed));
                    sides.entry(scene).or_default().push([left, right]);
                    views.extend(comparison.variants().find_map(run).map(|run| (scene, &run.train_views)));
                }
                _ => incomplete += usize::from(comparison.variants().any(|variant| run(variant).is_some())),
            }
        }
        let scenes = differences(comparison.is, sides.into_values().collect());
        let (these, alike) = (Interval::on_these_scenes(&scenes), Interval::on_similar_scenes(&scenes));
        let single = scenes.first().map(|scene| Interval { mean: scene[0], bounds: None });
        let difference = these.or(alike).or(single);
        let decimals = quantity.decimals;
        let in_paper = paper.and_then(|paper| {
            let value = |variant: &str| paper.value(variant, quantity).map(|value| compared(quantity, value));
            let sides = [comparison.left.value(value)?, comparison.right.value(value)?];
            Some(format!("{:+.decimals$}", differences(comparison.is, vec![vec![sides]])[0][0]))
        });
        let found = difference.map(|interval| {
            let pairs = describe_pairs(&scenes, if views.len() > scenes.len() { "view set" } else { "seed" });
            let alike = these.and(alike).map_or(String::new(), |alike| {
                format!("; {alike:.decimals$} on scenes like them (mixed model, REML, Satterthwaite)")
            });
            let remark =
                |n: usize, what: &str| if n > 0 { format!("; {} {what}", counted(n, "pair")) } else { String::new() };
            let collapsed = remark(collapsed, "with a collapsed run");
            let incomplete = remark(incomplete, "incomplete and left out");
            format!("{interval:.decimals$} {pairs}{alike}{collapsed}{incomplete}")
        });
        Self {
            formula: formula(claim, comparison, records),
            found: found.unwrap_or_else(|| "no runs".to_owned()),
            in_paper: in_paper.unwrap_or_default(),
            verdict: difference.map_or(Verdict::Untested, |interval| verdict(claim, comparison.is, interval)),
        }
    }
}

/// Describes the number of pairs of each scene, such as `on these 4 scenes × 5 view sets`.
fn describe_pairs(scenes: &[Vec<f64>], repeat: &str) -> String {
    let (count, first, pairs) = (scenes.len(), scenes[0].len(), scenes.iter().map(Vec::len).sum());
    if count == 1 {
        format!("over {} of one scene", counted(pairs, repeat))
    } else if pairs == count {
        format!("over {}", counted(count, "scene"))
    } else if scenes.iter().all(|pairs| pairs.len() == first) {
        format!("on these {count} scenes × {}", counted(first, repeat))
    } else {
        format!("on these {count} scenes, {} in all", counted(pairs, repeat))
    }
}

/// Maps the value of a quantity that is best at 1 to its distance from 1, for which less is better; keeps other values.
fn compared(quantity: Quantity, value: f64) -> f64 {
    if quantity.better == Better::NearOne { (value - 1.0).abs() } else { value }
}

/// Returns left minus right of each scene's pairs; for *near* `|left| − ½ |right|` with the signs of the sides' means.
/// Absolute values of single pairs would count noise around 0 as a distance.
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
    let Some([low, high]) = difference.bounds else { return Verdict::Undecided };
    let less_is_better = relation == Relation::Near || claim.metric.better != Better::Higher;
    let in_favour = if less_is_better { [-high, -low] } else { [low, high] };
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
    let better = claim.metric.better;
    let label = |variant: &str| {
        let run = records.iter().find(|record| record.variant == variant);
        run.map_or_else(|| variant.to_owned(), Record::label)
    };
    let [left, right] = [&comparison.left, &comparison.right].map(|side| match side {
        Side::Variant(variant) => label(variant),
        Side::Difference([above, below]) => format!("{} − {}", label(above), label(below)),
    });
    let (name, margin) = (claim.metric.name(), claim.margin);
    let name = if better == Better::NearOne { format!("|{name} − 1|") } else { name };
    let [sign, worse] = if better == Better::Higher { [">", "−"] } else { ["<", "+"] };
    match comparison.is {
        Relation::Better => format!("{name}: {left} {sign} {right}"),
        Relation::NotWorse => format!("{name}: {left} {sign} {right} {worse} {margin}"),
        Relation::Near => format!("{name}: |{left}| ≤ ½ |{right}|"),
    }
}
