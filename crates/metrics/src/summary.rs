use std::fmt;

/// Mean and spread of several values, such as those of several seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Arithmetic mean.
    pub mean: f64,
    /// Sample standard deviation `sqrt(Σ (x − mean)² / (n − 1))`; `None` for a single value.
    pub std: Option<f64>,
    /// Number of values.
    pub n: usize,
}

impl Summary {
    /// Summarises `values`; `None` if there are none. Values that are not finite make the mean not finite.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let n = values.len();
        if n == 0 {
            return None;
        }
        let mean = values.iter().sum::<f64>() / n as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let std = (n > 1).then(|| (squares / (n - 1) as f64).sqrt());
        Some(Self { mean, std, n })
    }
}

impl fmt::Display for Summary {
    /// Writes `mean ± std`, or `mean` for a single value, with the formatter's precision (2 decimals by default).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let precision = f.precision().unwrap_or(2);
        match self.std {
            Some(std) => write!(f, "{:.precision$} ± {std:.precision$}", self.mean),
            None => write!(f, "{:.precision$}", self.mean),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_the_sample_standard_deviation_of_several_values() {
        let summary = Summary::of([1.0, 2.0, 3.0]).unwrap();
        assert_eq!(summary, Summary { mean: 2.0, std: Some(1.0), n: 3 });
        assert_eq!(format!("{summary:.1}"), "2.0 ± 1.0");
        assert_eq!(Summary::of([4.0]), Some(Summary { mean: 4.0, std: None, n: 1 }));
        assert_eq!(Summary::of([]), None);
    }
}
