//! Claims on the order of variants, such as a paper's, tested on records.

mod finding;

pub use finding::{Finding, Verdict};

use serde::Deserialize;

use crate::published::Published;
use crate::quantity::Quantity;
use crate::record::Record;

/// Statement on the order of variants, which holds if all of its comparisons do.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct Claim {
    /// Statement in words.
    pub statement: String,
    /// Quantity that is compared. A quantity that is best at 1 is compared by its distance from 1.
    pub metric: Quantity,
    /// Minimum difference that matters, in the metric's unit; 0 if none is given. *Not worse* allows a loss below the margin.
    /// *Better* fails if a gain of the margin is excluded.
    pub margin: f64,
    /// Comparisons, each of which has to hold.
    pub comparisons: Vec<Comparison>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked {
    statement: String,
    metric: Quantity,
    margin: Option<f64>,
    comparisons: Vec<Comparison>,
}

impl TryFrom<Unchecked> for Claim {
    type Error = String;

    fn try_from(Unchecked { statement, metric, margin, comparisons }: Unchecked) -> Result<Self, String> {
        let needs_margin = comparisons.iter().any(|comparison| comparison.is == Relation::NotWorse);
        match margin {
            None if needs_margin => Err(format!(
                "`{statement}`: `not-worse` expects a `margin`: how much worse still counts as not worse, in the unit of {}",
                metric.key
            )),
            Some(margin) if !(margin > 0.0 && margin.is_finite()) => {
                Err(format!("`{statement}`: margin: expected a number above 0, found {margin}"))
            }
            margin => Ok(Self { statement, metric, margin: margin.unwrap_or(0.0), comparisons }),
        }
    }
}

/// Claimed relation between two sides.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Side left of the sign.
    pub left: Side,
    /// Relation that is claimed.
    pub is: Relation,
    /// Side right of the sign.
    pub right: Side,
}

/// Side of a [`Comparison`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Side {
    /// Value of a variant.
    Variant(String),
    /// Value of the first variant minus that of the second.
    Difference([String; 2]),
}

/// Relation of the left side of a [`Comparison`] to the right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Relation {
    /// Better than the right side.
    Better,
    /// Worse by less than the claim's margin.
    NotWorse,
    /// At most half of the right side, both as distances: |left| ≤ ½ |right|.
    Near,
}

/// [`Claim`] with its findings.
#[derive(Debug, Clone, PartialEq)]
pub struct TestedClaim {
    /// Statement of the claim.
    pub statement: String,
    /// Least favourable verdict of the findings.
    pub verdict: Verdict,
    /// Finding of each comparison.
    pub findings: Vec<Finding>,
}

impl Claim {
    /// Tests the claim on `records`.
    ///
    /// Differences are taken within pairs of the same scene and view set (seed), so that the difficulty of scenes and views
    /// cancels. The 95 % confidence interval of the mean difference decides. *Better* holds if the whole interval is above zero,
    /// and fails if the whole interval is below the margin, as in a test of equivalence. *Not worse* holds if it is above
    /// −margin, and fails if it is below. *Near* holds if the whole interval of |left| − ½ |right|, with the signs of the sides'
    /// means, is below zero, and fails if it is above. The interval is over other view sets of *these scenes*, as for the mean of
    /// a benchmark. The wider interval over *scenes like these* (a mixed model) is reported as well, and decides if each scene
    /// has one view set. Collapsed runs count with their values. A single pair decides nothing.
    pub fn test(&self, records: &[Record], published: Option<&Published>) -> TestedClaim {
        let test = |comparison: &Comparison| Finding::of(self, comparison, records, published);
        let findings: Vec<Finding> = self.comparisons.iter().map(test).collect();
        let verdict = findings.iter().map(|finding| finding.verdict).max().unwrap_or(Verdict::Untested);
        TestedClaim { statement: self.statement.clone(), verdict, findings }
    }

    /// Returns every variant that the claim names.
    pub fn variants(&self) -> impl Iterator<Item = &str> {
        self.comparisons.iter().flat_map(Comparison::variants)
    }
}

impl Comparison {
    fn variants(&self) -> impl Iterator<Item = &str> {
        [&self.left, &self.right].into_iter().flat_map(Side::variants).map(String::as_str)
    }
}

impl Side {
    fn variants(&self) -> &[String] {
        match self {
            Self::Variant(name) => std::slice::from_ref(name),
            Self::Difference(names) => names,
        }
    }

    fn value(&self, value: impl Fn(&str) -> Option<f64>) -> Option<f64> {
        match self {
            Self::Variant(variant) => value(variant),
            Self::Difference([above, below]) => Some(value(above)? - value(below)?),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::table::tests::record;

    /// Makes a claim of `left is right`, where a side is a variant or `above - below`.
    fn claim(left: &str, is: Relation, right: &str) -> Claim {
        let side = |text: &str| match text.split_once(" - ") {
            Some((above, below)) => Side::Difference([above.to_owned(), below.to_owned()]),
            None => Side::Variant(text.to_owned()),
        };
        let comparison = Comparison { left: side(left), is, right: side(right) };
        Claim { statement: "s".into(), metric: Quantity::PSNR, margin: 0.5, comparisons: vec![comparison] }
    }

    fn records(variants: &[(&str, [f64; 3])]) -> Vec<Record> {
        let of = |(variant, [x, y, z]): &(&str, [f64; 3])| {
            [("x", *x), ("y", *y), ("z", *z)].map(|(scene, psnr)| record(scene, variant, 0, psnr))
        };
        variants.iter().flat_map(of).collect()
    }

    #[test]
    fn differences_are_paired_and_noise_is_no_order() {
        // Scenes differ by ten, and the variants by one on each of them.
        let list = records(&[
            ("a", [10.0, 20.0, 30.1]),
            ("b", [11.0, 21.1, 31.0]),
            ("c", [9.0, 21.0, 30.1]),
            ("d", [10.0, 20.1, 30.0]),
            // Differences of these are compared as well.
            ("few", [10.0, 10.1, 10.2]),
            ("info", [18.0; 3]),
            ("many", [20.0; 3]),
            ("both", [20.5; 3]),
        ]);
        for (left, is, right, verdict, formula) in [
            ("b", Relation::Better, "a", Verdict::Holds, "b > a"),
            ("a", Relation::Better, "b", Verdict::Fails, "a > b"),
            ("a", Relation::NotWorse, "b", Verdict::Fails, "a > b − 0.5"),
            ("a", Relation::Better, "c", Verdict::Undecided, "a > c"),
            // A gain as large as the margin is excluded.
            ("d", Relation::Better, "a", Verdict::Fails, "d > a"),
            // The interval contains losses of more than the margin.
            ("c", Relation::NotWorse, "a", Verdict::Undecided, "c > a − 0.5"),
            ("d", Relation::NotWorse, "a", Verdict::Holds, "d > a − 0.5"),
            ("a", Relation::Better, "none", Verdict::Untested, "a > none"),
            ("info - few", Relation::Better, "both - many", Verdict::Holds, "info − few > both − many"),
            ("info - many", Relation::Near, "few - many", Verdict::Holds, "|info − many| ≤ ½ |few − many|"),
            ("few - many", Relation::Near, "few - many", Verdict::Fails, "|few − many| ≤ ½ |few − many|"),
        ] {
            let finding = claim(left, is, right).test(&list, None).findings.remove(0);
            assert_eq!((finding.verdict, finding.formula), (verdict, format!("PSNR (dB): {formula}")));
        }
        let found = |left, right| claim(left, Relation::Better, right).test(&list, None).findings.remove(0).found;
        assert_eq!(found("b", "a"), "+1.00 [+0.75, +1.25] over 3 scenes");
        assert_eq!(found("info - few", "both - many"), "+7.40 [+7.15, +7.65] over 3 scenes");
    }

    /// A gain on one scene and a smaller loss on the other are a gain on these two scenes, but decide nothing for others.
    #[test]
    fn interval_of_these_scenes_decides() {
        let pairs = |(scene, gain)| {
            let b = move |seed| record(scene, "b", seed, 20.0 + gain + 0.01 * seed as f64);
            (0..4).flat_map(move |seed| [record(scene, "a", seed, 20.0), b(seed)])
        };
        let mut list: Vec<Record> = [("x", 1.0), ("y", -0.8)].into_iter().flat_map(pairs).collect();
        let found = |list: &[Record]| {
            let finding = claim("b", Relation::Better, "a").test(list, None).findings.remove(0);
            (finding.verdict, finding.found)
        };
        let (verdict, text) = found(&list);
        assert_eq!(verdict, Verdict::Holds);
        let expected = "+0.12 [+0.10, +0.13] on these 2 scenes × 4 seeds; +0.12 [-11.32, +11.55] on scenes like them";
        assert!(text.starts_with(expected), "{text}");
        assert_eq!(found(&list[..8]), (Verdict::Holds, "+1.02 [+0.99, +1.04] over 4 seeds of one scene".into()));
        assert_eq!(found(&list[..2]), (Verdict::Undecided, "+1.00 over 1 seed of one scene".into()));
        list[2..4].iter_mut().for_each(|record| record.train_views = vec![1]);
        assert!(found(&list[..10]).1.contains("on these 2 scenes, 5 view sets in all; "));
        assert!(found(&[&list[..2], &list[8..10]].concat()).1.ends_with("over 2 scenes"));
    }

    #[test]
    fn collapsed_pairs_count_and_incomplete_pairs_are_named() {
        let mut list = records(&[("a", [10.0, 20.0, 30.0]), ("b", [11.0, 21.1, 5.0])]);
        list[5].collapsed = true;
        let found = |list: &[Record]| claim("b", Relation::Better, "a").test(list, None).findings.remove(0).found;
        let text = found(&list);
        assert!(text.starts_with("-7.6") && text.ends_with("over 3 scenes; 1 pair with a collapsed run"), "{text}");
        let text = found(&list[..5]);
        assert!(text.ends_with("over 2 scenes; 1 pair incomplete and left out"), "{text}");
    }

    #[test]
    fn lower_is_better_for_some_and_the_worst_finding_counts() {
        let mut list = records(&[("a", [1.0; 3]), ("b", [2.0; 3])]);
        for record in &mut list {
            record.ray_entropy_bits = record.metrics["psnr"];
        }
        let mut one = Claim { metric: Quantity::RAY_ENTROPY, ..claim("a", Relation::Better, "b") };
        assert_eq!(one.test(&list, None).verdict, Verdict::Holds);
        assert_eq!(one.test(&list, None).findings[0].formula, "Ray entropy (bits): a < b");
        one.comparisons.extend(claim("b", Relation::NotWorse, "a").comparisons);
        assert_eq!(one.test(&list, None).verdict, Verdict::Fails);
        assert_eq!(one.variants().collect::<Vec<_>>(), ["a", "b", "b", "a"]);
    }

    /// Sharpness is best at 1: 0.9 beats 1.3 and 0.6, and half of the distance is *near*.
    #[test]
    fn quantities_best_at_one_are_compared_by_distance() {
        let mut all = records(&[("sharp", [1.3, 1.31, 1.32]), ("good", [0.9, 0.91, 0.92]), ("soft", [0.6, 0.61, 0.6])]);
        for record in &mut all {
            record.metrics = [("sharpness".to_owned(), record.metrics["psnr"])].into_iter().collect();
        }
        let metric = Quantity::named("sharpness").unwrap();
        for (left, is, right, verdict, formula) in [
            ("good", Relation::Better, "sharp", Verdict::Holds, "good < sharp"),
            ("good", Relation::Better, "soft", Verdict::Holds, "good < soft"),
            ("sharp", Relation::Better, "good", Verdict::Fails, "sharp < good"),
            ("good", Relation::Near, "soft", Verdict::Holds, "|good| ≤ ½ |soft|"),
        ] {
            let finding = Claim { metric, ..claim(left, is, right) }.test(&all, None).findings.remove(0);
            assert_eq!((finding.verdict, finding.formula), (verdict, format!("|Sharpness − 1|: {formula}")));
        }
    }

    /// Two variants whose views differ by 0.9 either way are near each other, as the scenes' mean difference is 0.
    #[test]
    fn noise_about_zero_is_near() {
        let mut list = Vec::new();
        for (seed, noise) in [(0, 0.9), (1, -0.9), (2, 0.8), (3, -0.8), (4, 0.85), (5, -0.85)] {
            for (variant, psnr) in [("few", 15.0), ("many", 18.0), ("info", 18.0 + noise), ("half", 16.0 + noise)] {
                list.push(record("x", variant, seed, psnr));
            }
        }
        let near = |left| claim(left, Relation::Near, "few - many").test(&list, None).verdict;
        assert_eq!(near("info - many"), Verdict::Holds);
        assert_ne!(near("half - many"), Verdict::Holds, "two thirds of the way off");
    }

    #[test]
    fn a_margin_belongs_to_not_worse() {
        let parse = |margin: Option<f64>| {
            let comparison = json!({ "left": "a", "is": "not-worse", "right": "b" });
            let text = json!({ "statement": "s", "metric": "psnr", "margin": margin, "comparisons": [comparison] });
            serde_json::from_value::<Claim>(text).map(|claim| claim.margin).map_err(|error| error.to_string())
        };
        assert_eq!(parse(Some(0.1)), Ok(0.1));
        assert!(parse(None).unwrap_err().contains("`not-worse` expects a `margin`"));
        assert!(parse(Some(0.0)).unwrap_err().contains("above 0"));
    }
}
