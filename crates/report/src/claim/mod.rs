//! Claims about the order of variants, such as a paper's, tested on records.

mod finding;
mod interval;

use std::fmt;

use serde::Deserialize;

pub use finding::Finding;
pub use interval::Interval;

use crate::{Published, Quantity, Record};

/// A statement on the order of variants: all of its comparisons together.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct Claim {
    /// In words.
    pub statement: String,
    /// What is compared.
    pub metric: Quantity,
    /// The smallest difference that matters, in the metric's unit: what *not worse* allows for, and what a *better* that fails
    /// has been shown not to reach. 0 if none is given.
    pub margin: f64,
    /// Each of which has to hold.
    pub comparisons: Vec<Comparison>,
}

/// A claim as a file has it.
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

/// One relation between two sides.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Left of the sign.
    pub left: Side,
    /// The sign.
    pub is: Relation,
    /// Right of the sign.
    pub right: Side,
}

/// What a comparison compares.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Side {
    /// A variant.
    Variant(String),
    /// How far the first variant is above the second.
    Difference([String; 2]),
}

/// How the left of a [`Comparison`] is to the right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Relation {
    /// Better.
    Better,
    /// Worse by less than the claim's margin.
    NotWorse,
    /// At most half of it, both taken as distances: |left| ≤ ½ |right|.
    Near,
}

/// What the records say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// It holds.
    Holds,
    /// The difference is within the noise.
    Undecided,
    /// There are no runs to tell.
    Untested,
    /// It does not hold.
    Fails,
}

/// A [`Claim`] with what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct TestedClaim {
    /// The claim's.
    pub statement: String,
    /// The least favourable of the findings.
    pub verdict: Verdict,
    /// One per comparison.
    pub findings: Vec<Finding>,
}

impl Claim {
    /// Tests the claim on `records`.
    ///
    /// Differences are taken within pairs of the same scene and view set (seed), so that hard scenes and lucky views
    /// cancel. What decides is the 95 % confidence interval of their mean: *better* holds if all of it is above zero and
    /// fails if all of it is below the margin, the smallest difference that matters (a gain of that size is excluded then,
    /// as in a test of equivalence; 0 if none is given); *not worse* holds if all of it is above −margin and fails if all of
    /// it is below. It is the interval over other
    /// view sets of *these scenes*, which is what a mean over a benchmark's scenes with its spread speaks of; the wider
    /// one over *scenes like these* (a mixed model) stands beside it, and decides where scenes have one view set each.
    /// Runs that collapsed count with what they show. A single pair decides nothing.
    pub fn test(&self, records: &[Record], published: Option<&Published>) -> TestedClaim {
        let test = |comparison: &Comparison| Finding::of(self, comparison, records, published);
        let findings: Vec<Finding> = self.comparisons.iter().map(test).collect();
        let verdict = findings.iter().map(|finding| finding.verdict).max().unwrap_or(Verdict::Untested);
        TestedClaim { statement: self.statement.clone(), verdict, findings }
    }

    /// Every variant that it names.
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
    fn these_scenes_decide_and_scenes_like_them_stand_beside() {
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
    fn what_collapsed_counts_and_what_is_left_out_is_told() {
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
