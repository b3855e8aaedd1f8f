use std::fmt;

use infonerf_metrics::Summary;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Confidence level: share of repeated experiments whose interval contains the true mean.
const CONFIDENCE: f64 = 0.95;
/// Share of the total sum of squares below which a sum of squares is taken for a rounding error.
const ROUNDING: f64 = 1e-18;

/// Mean with its 95 % confidence interval: mean ± t SE, where t is the 97.5 % quantile of Student's distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Estimate of the mean.
    pub mean: f64,
    /// Lower and upper end; `None` for a single value, from which no spread can be estimated.
    pub bounds: Option<[f64; 2]>,
}

impl Interval {
    /// Returns the mean of independent values: SE = s/√n with n − 1 degrees of freedom; `None` without any.
    fn of(values: &[f64]) -> Option<Self> {
        Summary::of(values.iter().copied()).map(|summary| Self::of_summary(&summary))
    }

    /// Returns the mean of `summary` with its interval, as [`Interval::of`] does from the values.
    pub(crate) fn of_summary(summary: &Summary) -> Self {
        let n = summary.n as f64;
        Self::student(summary.mean, summary.std.unwrap_or(0.0) / n.sqrt(), n - 1.0)
    }

    fn student(mean: f64, se: f64, degrees: f64) -> Self {
        let student = StudentsT::new(0.0, 1.0, degrees).ok();
        let half = student.map(|student| student.inverse_cdf(0.5 + 0.5 * CONFIDENCE) * se);
        Self { mean, bounds: half.map(|half| [mean - half, mean + half]) }
    }

    /// Estimates the mean difference over exactly these scenes (a difference per view set, at least one), each with the
    /// same weight, over other view sets: a linear model with the `a` scenes as fixed effects. SE = s √(Σ 1/n)/a, where s²
    /// = Σ (d − scene's mean)² / (N − a) is pooled over the scenes and has N − a degrees of freedom. For a single scene
    /// this is Student's paired test.
    ///
    /// View sets of one scene count as independent of those of another. The paper's spreads agree with that: NeRF's
    /// standard deviations on its eight scenes (Table 2) make 3.05/√8 = 1.08 dB for their mean, where Table 1 has 1.06.
    ///
    /// Returns `None` if every scene has a single pair, from which the spread over view sets cannot be estimated.
    pub(crate) fn on_these_scenes(scenes: &[Vec<f64>]) -> Option<Self> {
        let moments: Vec<[f64; 3]> = scenes.iter().map(|scene| moments(scene)).collect();
        let count = scenes.len() as f64;
        let sum = |term: fn(&[f64; 3]) -> f64| moments.iter().map(term).sum::<f64>();
        let degrees = sum(|[n, ..]| *n) - count;
        let variance = sum(|[.., squares]| *squares) / degrees;
        let se = (variance * sum(|[n, ..]| 1.0 / n)).sqrt() / count;
        (degrees > 0.0).then(|| Self::student(sum(|[_, mean, _]| *mean) / count, se, degrees))
    }

    /// Estimates the mean over scenes like these, `None` for a single one: the mixed model d = μ + b_scene + e with independent
    /// normal b and e, fitted by restricted maximum likelihood (REML), the degrees of freedom by Satterthwaite's method as in
    /// lmerTest. If all scenes have equally many pairs and differ more than their pairs do, this is Student's test of their means.
    pub(crate) fn on_similar_scenes(scenes: &[Vec<f64>]) -> Option<Self> {
        let moments: Vec<[f64; 3]> = scenes.iter().map(|scene| moments(scene)).collect();
        let means: Vec<f64> = moments.iter().map(|[_, mean, _]| *mean).collect();
        let within: f64 = moments.iter().map(|[.., squares]| squares).sum();
        let total: f64 = scenes.iter().flatten().map(|d| d * d).sum();
        if scenes.len() < 2 {
            None
        } else if within <= ROUNDING * total {
            Self::of(&means)
        } else {
            Some(reml(&moments, within))
        }
    }
}

/// Returns n, the mean and Σ (x − mean)² of `values`.
fn moments(values: &[f64]) -> [f64; 3] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    [n, mean, values.iter().map(|value| (value - mean).powi(2)).sum()]
}

/// Fits the mixed model of scenes by their [`moments`]; `within` is the sum of their squares.
///
/// With λ = Var b / Var e, a scene has the weight w = n/(1 + λn), and μ = Σ w·mean / Σ w. REML minimises the deviance
/// (N − 1) ln s² + R/s² + Σ ln(1 + λn) + ln Σ w, where R = within + Σ w (mean − μ)², so s² = R/(N − 1), over λ ≥ 0. The
/// squared standard error of μ is V = s²/Σ w. Its degrees of freedom (Satterthwaite) are 2 V²/Var V = 1/(gᵀH⁻¹g) with the
/// deviance's Hessian H in (ln s², λ) and g the gradient of ln V; N − 1 where λ = 0.
fn reml(moments: &[[f64; 3]], within: f64) -> Interval {
    let free = moments.iter().map(|[n, ..]| n).sum::<f64>() - 1.0;
    let weight = |n: f64, lambda: f64| n / (1.0 + lambda * n);
    let sum = |lambda: f64, power: i32, term: &dyn Fn(f64) -> f64| -> f64 {
        moments.iter().map(|&[n, mean, _]| weight(n, lambda).powi(power) * term(mean)).sum()
    };
    // Σ w^power (mean − μ)^degree.
    let residual = |lambda: f64, power: i32, degree: i32| {
        let mu = sum(lambda, 1, &|mean| mean) / sum(lambda, 1, &|_| 1.0);
        sum(lambda, power, &|mean| (mean - mu).powi(degree))
    };
    let variance = |lambda: f64| (within + residual(lambda, 1, 2)) / free;
    // Derivative of the deviance by λ, at the best s².
    let gradient = |lambda: f64| {
        let (w, w2) = (residual(lambda, 1, 0), residual(lambda, 2, 0));
        w - w2 / w - residual(lambda, 2, 2) / variance(lambda)
    };
    // Bisection in λ/(1 + λ), the correlation of pairs of one scene.
    let lambda_of = |correlation: f64| correlation / (1.0 - correlation);
    let (mut low, mut high) = (0.0, 1.0 - 1e-12);
    while high - low > 1e-14 {
        let middle = 0.5 * (low + high);
        if gradient(lambda_of(middle)) < 0.0 { low = middle } else { high = middle }
    }
    let lambda = if gradient(0.0) < 0.0 { lambda_of(low) } else { 0.0 };

    let [w, w2, w3] = [1, 2, 3].map(|power| residual(lambda, power, 0));
    let s2 = variance(lambda);
    let mixed = residual(lambda, 2, 2) / s2;
    let curvature = (2.0 * residual(lambda, 3, 2) - 2.0 * residual(lambda, 2, 1).powi(2) / w) / s2 - w2 + 2.0 * w3 / w
        - (w2 / w).powi(2);
    let log_gradient = w2 / w;
    let determinant = free * curvature - mixed * mixed;
    let degrees = determinant / (curvature - 2.0 * log_gradient * mixed + log_gradient * log_gradient * free);
    let degrees = if lambda > 0.0 { degrees } else { free };
    Interval::student(sum(lambda, 1, &|mean| mean) / w, (s2 / w).sqrt(), degrees)
}

impl fmt::Display for Interval {
    /// Writes `+0.42 [+0.10, +0.74]`, with the formatter's precision (2 decimals when none is given).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let precision = f.precision().unwrap_or(2);
        // Zero is written without a minus.
        let shown = |value: f64| {
            let text = format!("{value:+.precision$}");
            if text.trim_matches(['+', '-', '0', '.']).is_empty() { format!("{:+.precision$}", 0.0) } else { text }
        };
        let bounds = self.bounds.map(|[low, high]| format!(" [{}, {}]", shown(low), shown(high)));
        write!(f, "{}{}", shown(self.mean), bounds.unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    struct Case {
        case: String,
        scenes: Vec<Vec<f64>>,
        /// Mean, low end and high end of an interval, by name.
        these: Option<HashMap<String, f64>>,
        alike: Option<HashMap<String, f64>>,
    }

    /// Compares with R's t.test and lm, and lmer with lmerTest: `tests/claim/reference.R`.
    #[test]
    fn intervals_are_those_of_r() {
        let cases: Vec<Case> = serde_json::from_str(include_str!("../tests/claim/reference.json")).unwrap();
        assert_eq!(cases.len(), 7);
        for Case { case, scenes, these, alike } in cases {
            let found = [Interval::on_these_scenes(&scenes), Interval::on_similar_scenes(&scenes)];
            for (found, expected) in found.into_iter().zip([these, alike]) {
                assert_eq!(found.is_some(), expected.is_some(), "{case}: {found:?}");
                let (Some(Interval { mean, bounds }), Some(expected)) = (found, expected) else { continue };
                let [low, high] = bounds.unwrap();
                for (found, key) in [(mean, "mean"), (low, "low"), (high, "high")] {
                    let expected = expected[key];
                    assert!((found - expected).abs() < 2e-6 * (high - low), "{case}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn scenes_whose_pairs_agree_count_once() {
        let scenes = [vec![1.0; 4], vec![2.0; 4], vec![4.0; 2]];
        assert_eq!(Interval::on_similar_scenes(&scenes), Interval::of(&[1.0, 2.0, 4.0]));
        assert_eq!(Interval::of(&[4.0]), Some(Interval { mean: 4.0, bounds: None }));
        assert_eq!(Interval::of(&[]), None);
    }

    #[test]
    fn zero_has_no_minus() {
        assert_eq!(Interval { mean: -0.001, bounds: Some([-0.004, 0.2]) }.to_string(), "+0.00 [+0.00, +0.20]");
    }
}
