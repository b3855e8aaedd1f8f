//! What a paper says about the order of variants, tested on records.

use std::fmt;

use infonerf_metrics::Summary;
use serde::Deserialize;

use crate::{
    Metric, Published, Record,
    table::{Better, distinct},
};

/// How far a mean may be from zero to count as noise, in standard errors.
const STANDARD_ERRORS: f64 = 2.0;

/// A statement on the order of variants: all of its comparisons together.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// In words.
    pub statement: String,
    /// What is compared.
    pub metric: Metric,
    /// Each of which has to hold.
    pub comparisons: Vec<Comparison>,
}

/// One relation between two quantities.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Left of the sign.
    pub left: Quantity,
    /// The sign.
    pub is: Relation,
    /// Right of the sign.
    pub right: Quantity,
}

/// What a comparison compares.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Quantity {
    /// A variant.
    Variant(String),
    /// How far the first variant is above the second.
    Difference([String; 2]),
}

/// How the left of a [`Comparison`] is to the right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Relation {
    /// Better by more than the noise.
    Better,
    /// Not worse by more than the noise.
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
    /// One a comparison.
    pub findings: Vec<Finding>,
}

/// A [`Comparison`] with what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The comparison as a formula, such as `PSNR: entropy > none`.
    pub formula: String,
    /// What stands left of the sign minus what stands right of it, of each scene and seed that has all of its variants.
    pub difference: Option<Summary>,
    /// The same difference in the paper, where it gives both sides.
    pub published: Option<f64>,
    /// What they say.
    pub verdict: Verdict,
    decimals: usize,
}

impl Claim {
    /// Tests the claim on `records`.
    ///
    /// Differences are taken within a scene and seed, so that hard scenes and lucky views cancel. A mean difference of
    /// no more than two standard errors is noise: too little for *better*, and no objection to *not worse*. A single
    /// pair tells nothing of its noise, and decides nothing.
    #[must_use]
    pub fn test(&self, records: &[Record], published: Option<&Published>) -> TestedClaim {
        let findings: Vec<Finding> =
            self.comparisons.iter().map(|comparison| comparison.test(self.metric, records, published)).collect();
        let verdict = findings.iter().map(|finding| finding.verdict).max().unwrap_or(Verdict::Untested);
        TestedClaim { statement: self.statement.clone(), verdict, findings }
    }

    /// Every variant that it names.
    pub fn variants(&self) -> impl Iterator<Item = &str> {
        self.comparisons
            .iter()
            .flat_map(|comparison| [&comparison.left, &comparison.right])
            .flat_map(Quantity::variants)
    }
}

impl Comparison {
    fn test(&self, metric: Metric, records: &[Record], published: Option<&Published>) -> Finding {
        let value = |variant: &str, scene: &str, seed: u64| {
            let record = records.iter().find(|r| r.variant == variant && r.scene == scene && r.seed == seed)?;
            metric.value(record).filter(|_| !record.collapsed)
        };
        let pairs = distinct(records, |record| (record.scene.clone(), record.seed));
        let sides = pairs.iter().filter_map(|(scene, seed)| self.sides(|variant| value(variant, scene, *seed)));
        let sides: Vec<(f64, f64)> = sides.collect();
        let in_paper = published.and_then(|published| self.sides(|variant| published.value(variant, metric)));
        Finding {
            formula: self.formula(metric),
            difference: Summary::of(sides.iter().map(|(left, right)| left - right)),
            published: in_paper.map(|(left, right)| left - right),
            verdict: self.verdict(metric, &sides),
            decimals: metric.decimals(),
        }
    }

    /// Left and right of the sign, in the metric's unit.
    fn sides(&self, value: impl Fn(&str) -> Option<f64>) -> Option<(f64, f64)> {
        let (left, right) = (self.left.value(&value)?, self.right.value(&value)?);
        Some(if self.is == Relation::Near { (left.abs(), 0.5 * right.abs()) } else { (left, right) })
    }

    fn verdict(&self, metric: Metric, sides: &[(f64, f64)]) -> Verdict {
        let sign = if metric.better() == Better::Lower { -1.0 } else { 1.0 };
        let favour = sides.iter().map(|(left, right)| match self.is {
            Relation::Better | Relation::NotWorse => sign * (left - right),
            Relation::Near => right - left,
        });
        let Some(favour) = Summary::of(favour) else { return Verdict::Untested };
        let Some(std) = favour.std else { return Verdict::Undecided };
        let noise = STANDARD_ERRORS * std / (favour.n as f64).sqrt();
        match self.is {
            Relation::NotWorse if favour.mean >= -noise => Verdict::Holds,
            _ if favour.mean > noise => Verdict::Holds,
            _ if favour.mean >= -noise => Verdict::Undecided,
            _ => Verdict::Fails,
        }
    }

    fn formula(&self, metric: Metric) -> String {
        let lower = metric.better() == Better::Lower;
        let (left, right) = (&self.left, &self.right);
        let name = metric.heading().trim_end_matches([' ', '↑', '↓']);
        match (self.is, lower) {
            (Relation::Better, false) => format!("{name}: {left} > {right}"),
            (Relation::Better, true) => format!("{name}: {left} < {right}"),
            (Relation::NotWorse, false) => format!("{name}: {left} ≥ {right}"),
            (Relation::NotWorse, true) => format!("{name}: {left} ≤ {right}"),
            (Relation::Near, _) => format!("{name}: |{left}| ≤ ½ |{right}|"),
        }
    }
}

impl Quantity {
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

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variant(variant) => f.write_str(variant),
            Self::Difference([above, below]) => write!(f, "{above} − {below}"),
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

impl Finding {
    /// What was found, such as `+0.42 ± 0.10 in 4 pairs`.
    #[must_use]
    pub fn found(&self) -> String {
        let Some(Summary { mean, std, n }) = self.difference else { return "no runs".to_owned() };
        let decimals = self.decimals;
        let mean = if format!("{mean:.decimals$}").trim_start_matches(['-', '0', '.']).is_empty() { 0.0 } else { mean };
        let spread = std.map_or(String::new(), |std| format!(" ± {std:.decimals$}"));
        format!("{mean:+.decimals$}{spread} in {n} {}", if n == 1 { "pair" } else { "pairs" })
    }

    /// The paper's difference; empty where it gives none.
    #[must_use]
    pub fn in_paper(&self) -> String {
        let decimals = self.decimals;
        self.published.map_or(String::new(), |difference| format!("{difference:+.decimals$}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::record;

    fn claim(left: &[&str], is: Relation, right: &[&str]) -> Claim {
        let quantity = |names: &[&str]| match names {
            [above, below] => Quantity::Difference([above, below].map(|name| (*name).to_owned())),
            names => Quantity::Variant(names.concat()),
        };
        let comparison = Comparison { left: quantity(left), is, right: quantity(right) };
        Claim { statement: "s".into(), metric: Metric::Psnr, comparisons: vec![comparison] }
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
        let list = records(&[("a", [10.0, 20.0, 30.1]), ("b", [11.0, 21.1, 31.0]), ("c", [9.0, 21.0, 30.1])]);
        let verdict = |left, is, right| claim(&[left], is, &[right]).test(&list, None).verdict;
        assert_eq!(verdict("b", Relation::Better, "a"), Verdict::Holds);
        assert_eq!(verdict("a", Relation::Better, "b"), Verdict::Fails);
        assert_eq!(verdict("a", Relation::NotWorse, "b"), Verdict::Fails);
        assert_eq!(verdict("a", Relation::Better, "c"), Verdict::Undecided);
        assert_eq!(verdict("c", Relation::NotWorse, "a"), Verdict::Holds);
        assert_eq!(verdict("a", Relation::Better, "none"), Verdict::Untested);
        let one_scene = claim(&["b"], Relation::Better, &["a"]).test(&list[..4], None);
        assert_eq!(
            (one_scene.findings[0].found().as_str(), one_scene.verdict),
            ("+1.00 in 1 pair", Verdict::Undecided)
        );
        let tested = claim(&["b"], Relation::Better, &["a"]).test(&list, None);
        assert_eq!(tested.findings[0].formula, "PSNR (dB): b > a");
        assert_eq!(tested.findings[0].found(), "+1.00 ± 0.10 in 3 pairs");
    }

    #[test]
    fn differences_and_distances() {
        let list = records(&[("few", [10.0; 3]), ("info", [18.0; 3]), ("many", [20.0; 3]), ("both", [20.5; 3])]);
        let gain = claim(&["info", "few"], Relation::Better, &["both", "many"]).test(&list, None);
        assert_eq!((gain.verdict, gain.findings[0].found().as_str()), (Verdict::Holds, "+7.50 ± 0.00 in 3 pairs"));
        let near = |of| claim(&[of, "many"], Relation::Near, &["few", "many"]).test(&list, None).verdict;
        assert_eq!(near("info"), Verdict::Holds);
        assert_eq!(near("few"), Verdict::Fails);
    }

    #[test]
    fn lower_is_better_for_some_and_the_worst_finding_counts() {
        let mut list = records(&[("a", [1.0; 3]), ("b", [2.0; 3])]);
        for record in &mut list {
            record.ray_entropy_bits = record.psnr;
        }
        let mut claim = Claim { metric: Metric::RayEntropy, ..claim(&["a"], Relation::Better, &["b"]) };
        assert_eq!(claim.test(&list, None).verdict, Verdict::Holds);
        assert_eq!(claim.test(&list, None).findings[0].formula, "Ray entropy (bits): a < b");
        claim.comparisons.push(Comparison {
            left: Quantity::Variant("b".into()),
            is: Relation::NotWorse,
            right: Quantity::Variant("a".into()),
        });
        assert_eq!(claim.test(&list, None).verdict, Verdict::Fails);
        assert_eq!(claim.variants().collect::<Vec<_>>(), ["a", "b", "b", "a"]);
    }
}
