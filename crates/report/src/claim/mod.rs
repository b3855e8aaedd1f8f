//! Claims on the order of variants, such as a paper's, tested on records.

mod finding;
mod interval;

use std::fmt;

use serde::Deserialize;

pub use finding::Finding;
pub use interval::Interval;

use crate::{Published, Quantity, Record};

/// Statement on the order of variants, which holds if all of its comparisons do.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct Claim {
    /// Statement in words.
    pub statement: String,
    /// Quantity that is compared; one that is best at 1 by its distance from 1.
    pub metric: Quantity,
    /// Smallest difference that matters, in the metric's unit: the allowance of *not worse*, and the gain that a
    /// *better* that fails has been shown not to reach. 0 if none is given.
    pub margin: f64,
    /// Comparisons, each of which has to hold.
    pub comparisons: Vec<Comparison>,
}

/// Claim in a file, before it is checked.
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

    fn try_from(claim: Unchecked) -> Result<Self, String> {
        let Unchecked { statement, metric, margin, comparisons } = claim;
        let needs_margin = comparisons.iter().any(|comparison| comparison.is == Relation::NotWorse);
        match margin {
            None if needs_margin => Err(format!(
                "`{statement}`: `not-worse` expects a `margin`: how much worse still counts as not worse, in the unit of {}",
                metric.key()
            )),
            Some(margin) if !(margin > 0.0 && margin.is_finite()) => {
                Err(format!("`{statement}`: margin: expected a number above 0, found {margin}"))
            }
            margin => Ok(Self { statement, metric, margin: margin.unwrap_or(0.0), comparisons }),
        }
    }
}

/// Relation between two sides.
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
    /// Differences are taken within pairs of the same scene and view set (seed), so that hard scenes and lucky views
    /// cancel. The 95 % confidence interval of their mean decides: *better* holds if all of it is above zero and fails
    /// if all of it is below the margin (a gain of that size is excluded then, as in a test of equivalence); *not
    /// worse* holds if all of it is above −margin and fails if all of it is below; *near* holds if all of |left| − ½
    /// |right| is below zero, with the signs of the sides' means. It is the interval over other view sets of *these
    /// scenes*, as for a mean over a benchmark's scenes with its spread; the wider one over *scenes like these* (a
    /// mixed model) is given as well, and decides where scenes have one view set each. Runs that collapsed count as
    /// they are. A single pair decides nothing.
    pub fn test<R: AsRef<Record>>(&self, records: &[R], published: Option<&Published>) -> TestedClaim {
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
        [&self.left, &self.right].into_iter().flat_map(Side::variants)
    }
}

impl Side {
    fn variants(&self) -> impl Iterator<Item = &str> {
        let names = match self {
            Self::Variant(name) => std::slice::from_ref(name),
            Self::Difference(names) => names.as_slice(),
        };
        names.iter().map(String::as_str)
    }

    fn value(&self, value: impl Fn(&str) -> Option<f64>) -> Option<f64> {
        match self {
            Self::Variant(variant) => value(variant),
            Self::Difference([above, below]) => Some(value(above)? - value(below)?),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::record;

    fn side(names: &[&str]) -> Side {
        match names {
            [above, below] => Side::Difference([above, below].map(|name| (*name).to_owned())),
            names => Side::Variant(names.concat()),
        }
    }

    fn claim(left: &[&str], is: Relation, right: &[&str]) -> Claim {
        let comparison = Comparison { left: side(left), is, right: side(right) };
        Claim { statement: "s".into(), metric: Quantity::PSNR, margin: 0.5, comparisons: vec![comparison] }
    }

    /// Variants by their PSNR on each of three scenes.
    fn records(variants: &[(&str, [f64; 3])]) -> Vec<Record> {
        let of = |(variant, values): &(&str, [f64; 3])| {
            ["x", "y", "z"].iter().zip(values).map(|(scene, psnr)| record(scene, variant, 0, *psnr)).collect::<Vec<_>>()
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
        ]);
        let verdict = |left, is, right| claim(&[left], is, &[right]).test(&list, None).verdict;
        assert_eq!(verdict("b", Relation::Better, "a"), Verdict::Holds);
        assert_eq!(verdict("a", Relation::Better, "b"), Verdict::Fails);
        assert_eq!(verdict("a", Relation::NotWorse, "b"), Verdict::Fails);
        assert_eq!(verdict("a", Relation::Better, "c"), Verdict::Undecided);
        assert_eq!(verdict("d", Relation::Better, "a"), Verdict::Fails, "a gain as large as the margin is excluded");
        assert_eq!(
            verdict("c", Relation::NotWorse, "a"),
            Verdict::Undecided,
            "it may be worse by more than the margin"
        );
        assert_eq!(verdict("d", Relation::NotWorse, "a"), Verdict::Holds);
        assert_eq!(verdict("a", Relation::Better, "none"), Verdict::Untested);
        let tested = claim(&["b"], Relation::Better, &["a"]).test(&list, None);
        assert_eq!(tested.findings[0].formula, "PSNR (dB): b > a");
        assert_eq!(tested.findings[0].found(), "+1.00 [+0.75, +1.25] over 3 scenes");
        assert_eq!(
            claim(&["b"], Relation::NotWorse, &["a"]).test(&list, None).findings[0].formula,
            "PSNR (dB): b > a − 0.5"
        );
    }

    /// A gain on one scene and a loss on the other are a gain on these two, and say nothing of a third.
    #[test]
    fn interval_of_these_scenes_decides() {
        let mut list = Vec::new();
        for (scene, gain) in [("x", 1.0), ("y", -0.8)] {
            for seed in 0..4 {
                list.push(record(scene, "a", seed, 20.0));
                list.push(record(scene, "b", seed, 20.0 + gain + 0.01 * seed as f64));
            }
        }
        let found = |list: &[Record]| {
            let finding = claim(&["b"], Relation::Better, &["a"]).test(list, None).findings.remove(0);
            (finding.verdict, finding.found())
        };
        let (verdict, text) = found(&list);
        assert_eq!(verdict, Verdict::Holds);
        let expected = "+0.12 [+0.10, +0.13] on these 2 scenes × 4 seeds; +0.12 [-11.32, +11.55] on scenes like them";
        assert!(text.starts_with(expected), "{text}");
        let (verdict, text) = found(&list[..8]);
        assert_eq!((verdict, text.as_str()), (Verdict::Holds, "+1.02 [+0.99, +1.04] over 4 seeds of one scene"));
        assert_eq!(found(&list[..2]), (Verdict::Undecided, "+1.00 over 1 seed of one scene".into()));
        list[2..4].iter_mut().for_each(|record| record.train_views = vec![1]);
        assert!(found(&list[..10]).1.contains("on these 2 scenes, 5 view sets in all; "));
        let one_each = [&list[..2], &list[8..10]].concat();
        assert!(found(&one_each).1.ends_with("over 2 scenes"));
    }

    #[test]
    fn collapsed_pairs_count_and_incomplete_pairs_are_named() {
        let mut list = records(&[("a", [10.0, 20.0, 30.0]), ("b", [11.0, 21.1, 5.0])]);
        list[5].collapsed = true;
        let found = |list: &[Record]| claim(&["b"], Relation::Better, &["a"]).test(list, None).findings[0].found();
        let text = found(&list);
        assert!(text.starts_with("-7.6") && text.ends_with("over 3 scenes; 1 pair with a collapsed run"), "{text}");
        let text = found(&list[..5]);
        assert!(text.ends_with("over 2 scenes; 1 pair incomplete and left out"), "{text}");
    }

    #[test]
    fn differences_and_distances() {
        let list =
            records(&[("few", [10.0, 10.1, 10.2]), ("info", [18.0; 3]), ("many", [20.0; 3]), ("both", [20.5; 3])]);
        let gain = claim(&["info", "few"], Relation::Better, &["both", "many"]).test(&list, None);
        assert_eq!(gain.verdict, Verdict::Holds);
        assert_eq!(gain.findings[0].found(), "+7.40 [+7.15, +7.65] over 3 scenes");
        let near = |of| claim(&[of, "many"], Relation::Near, &["few", "many"]).test(&list, None).verdict;
        assert_eq!(near("info"), Verdict::Holds);
        assert_eq!(near("few"), Verdict::Fails);
    }

    #[test]
    fn lower_is_better_for_some_and_the_worst_finding_counts() {
        let mut list = records(&[("a", [1.0; 3]), ("b", [2.0; 3])]);
        for record in &mut list {
            record.ray_entropy_bits = record.metrics["psnr"];
        }
        let mut claim = Claim { metric: Quantity::RAY_ENTROPY, ..claim(&["a"], Relation::Better, &["b"]) };
        assert_eq!(claim.test(&list, None).verdict, Verdict::Holds);
        assert_eq!(claim.test(&list, None).findings[0].formula, "Ray entropy (bits): a < b");
        claim.comparisons.push(Comparison { left: side(&["b"]), is: Relation::NotWorse, right: side(&["a"]) });
        assert_eq!(claim.test(&list, None).verdict, Verdict::Fails);
        assert_eq!(claim.variants().collect::<Vec<_>>(), ["a", "b", "b", "a"]);
    }

    /// Sharpness is best at 1: 0.9 beats 1.3 and 0.6, and half of the distance is *near*.
    #[test]
    fn quantities_best_at_one_are_compared_by_distance() {
        let mut list =
            records(&[("sharp", [1.30, 1.31, 1.32]), ("good", [0.90, 0.91, 0.92]), ("soft", [0.6, 0.61, 0.6])]);
        for record in &mut list {
            record.metrics = [("sharpness".to_owned(), record.metrics["psnr"])].into_iter().collect();
        }
        let metric = Quantity::named("sharpness").unwrap();
        let better = |left, right| {
            let tested = Claim { metric, ..claim(&[left], Relation::Better, &[right]) }.test(&list, None);
            (tested.verdict, tested.findings[0].formula.clone())
        };
        assert_eq!(better("good", "sharp"), (Verdict::Holds, "|Sharpness − 1|: good < sharp".into()));
        assert_eq!(better("good", "soft").0, Verdict::Holds);
        assert_eq!(better("sharp", "good").0, Verdict::Fails);
        let near = Claim { metric, ..claim(&["good"], Relation::Near, &["soft"]) };
        assert_eq!(near.test(&list, None).verdict, Verdict::Holds);
    }

    /// Two equal variants whose views differ by 0.9 either way are near each other, as the scenes' mean difference is
    /// 0.
    #[test]
    fn noise_about_zero_is_near() {
        let mut list = Vec::new();
        for (seed, noise) in [(0, 0.9), (1, -0.9), (2, 0.8), (3, -0.8), (4, 0.85), (5, -0.85)] {
            list.push(record("x", "few", seed, 15.0));
            list.push(record("x", "many", seed, 18.0));
            list.push(record("x", "info", seed, 18.0 + noise));
            list.push(record("x", "half", seed, 16.0 + noise));
        }
        let near = |left| claim(&[left, "many"], Relation::Near, &["few", "many"]).test(&list, None);
        assert_eq!(near("info").verdict, Verdict::Holds, "{}", near("info").findings[0].found());
        assert_ne!(near("half").verdict, Verdict::Holds, "two thirds of the way off");
    }

    #[test]
    fn a_margin_belongs_to_not_worse() {
        let parse = |margin: &str| {
            let text = format!(
                "{{\"statement\": \"s\", \"metric\": \"psnr\",{margin} \"comparisons\": \
                 [{{\"left\": \"a\", \"is\": \"not-worse\", \"right\": \"b\"}}]}}"
            );
            serde_json::from_str::<Claim>(&text).map(|claim| claim.margin).map_err(|error| error.to_string())
        };
        assert_eq!(parse("\"margin\": 0.1,"), Ok(0.1));
        assert!(parse("").unwrap_err().contains("`not-worse` expects a `margin`"));
        assert!(parse("\"margin\": 0,").unwrap_err().contains("above 0"));
    }
}
