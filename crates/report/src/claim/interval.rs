use std::fmt;

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Share of repetitions whose interval holds the true mean.
const CONFIDENCE: f64 = 0.95;

/// Mean of independent values with its 95 % confidence interval: mean ± t s/√n, where t is the 97.5 % quantile of
/// Student's distribution with n − 1 degrees of freedom and s the sample standard deviation. A single value has no
/// interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Arithmetic mean.
    pub mean: f64,
    /// Lower and upper end.
    pub bounds: Option<[f64; 2]>,
    /// How many values.
    pub n: usize,
}

impl Interval {
    /// The interval of `values`; none without any.
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let student = StudentsT::new(0.0, 1.0, n.saturating_sub(1) as f64).ok();
        let bounds = student.filter(|_| n > 1).map(|student| {
            let half = student.inverse_cdf(0.5 + 0.5 * CONFIDENCE) * (squares / ((n - 1) * n) as f64).sqrt();
            [mean - half, mean + half]
        });
        (n > 0).then_some(Self { mean, bounds, n })
    }
}

impl fmt::Display for Interval {
    /// `+0.42 [+0.10, +0.74]`, with the formatter's precision (2 decimals when none is given).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let precision = f.precision().unwrap_or(2);
        // No "-0.00".
        let shown = |value: f64| {
            let text = format!("{value:+.precision$}");
            if text.trim_matches(['+', '-', '0', '.']).is_empty() { format!("{:+.precision$}", 0.0) } else { text }
        };
        f.write_str(&shown(self.mean))?;
        match self.bounds {
            Some([low, high]) => write!(f, " [{}, {}]", shown(low), shown(high)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_student() {
        // Quantiles from printed tables: 12.7062 for 1 degree of freedom, 4.3027 for 2, 3.1824 for 3.
        let cases = [(&[1.0, 3.0][..], 12.7062), (&[1.0, 2.0, 3.0], 4.3027), (&[0.0, 1.0, 2.0, 3.0], 3.1824)];
        for (values, quantile) in cases {
            let interval = Interval::of(values).unwrap();
            let n = values.len() as f64;
            let std = (values.iter().map(|x| (x - interval.mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
            let [low, high] = interval.bounds.unwrap();
            approx::assert_relative_eq!(high - low, 2.0 * quantile * std / n.sqrt(), max_relative = 1e-4);
        }
        assert_eq!(Interval::of(&[4.0]), Some(Interval { mean: 4.0, bounds: None, n: 1 }));
        assert_eq!(Interval::of(&[]), None);
    }

    #[test]
    fn zero_has_no_minus() {
        assert_eq!(Interval { mean: -0.001, bounds: Some([-0.004, 0.2]), n: 3 }.to_string(), "+0.00 [+0.00, +0.20]");
    }

    /// The interval of few values misses the true mean no more often than it says.
    #[test]
    fn one_in_twenty_misses() {
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for n in [2, 3, 4, 8] {
            let mut missed = 0;
            for _ in 0..4000 {
                // Box and Muller's normal numbers.
                let values: Vec<f64> = (0..n)
                    .map(|_| (-2.0 * (1.0 - uniform()).ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos())
                    .collect();
                let [low, high] = Interval::of(&values).unwrap().bounds.unwrap();
                missed += usize::from(low > 0.0 || high < 0.0);
            }
            assert!((150..250).contains(&missed), "{n} values: {missed} of 4000");
        }
    }
}
