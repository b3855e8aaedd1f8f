/// Power law `y = scale · x^exponent`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PowerLaw {
    /// Exponent of `x`.
    pub exponent: f64,
    /// Value at `x = 1`.
    pub scale: f64,
}

impl PowerLaw {
    /// Returns the value at `x`.
    pub fn at(self, x: f64) -> f64 {
        self.scale * x.powf(self.exponent)
    }
}

/// Fits a least-squares line through `(ln x, ln y)`; points that are not positive and finite are left out.
///
/// `None` for fewer than two different `x`.
pub fn fit_power_law(points: &[(f64, f64)]) -> Option<PowerLaw> {
    let usable = |value: f64| value.is_finite() && value > 0.0;
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(x, y)| usable(*x) && usable(*y)).map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let mean = |coordinate: fn(&(f64, f64)) -> f64| logs.iter().map(coordinate).sum::<f64>() / count;
    let (mean_x, mean_y) = (mean(|p| p.0), mean(|p| p.1));
    let variance: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    let covariance: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let exponent = covariance / variance;
    let law = PowerLaw { exponent, scale: (mean_y - exponent * mean_x).exp() };
    (variance > 1e-12 && exponent.is_finite() && law.scale.is_finite()).then_some(law)
}

/// Returns the points that no other beats in both coordinates, where smaller `x` and larger `y` are better, sorted by
/// `x`: the frontier of time against PSNR. Points that are not finite are left out.
pub fn pareto_frontier(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<(f64, f64)> = points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
    let mut frontier: Vec<(f64, f64)> = Vec::new();
    for point in sorted {
        if frontier.last().is_none_or(|last| point.1 > last.1) {
            frontier.push(point);
        }
    }
    frontier
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exact_law_is_found() {
        let points: Vec<(f64, f64)> = (1..6).map(|i| (f64::from(i), 3.0 * f64::from(i).powf(1.5))).collect();
        let law = fit_power_law(&points).unwrap();
        approx::assert_abs_diff_eq!(law.exponent, 1.5, epsilon = 1e-12);
        approx::assert_abs_diff_eq!(law.at(4.0), 24.0, epsilon = 1e-9);
    }

    #[test]
    fn one_abscissa_has_no_exponent() {
        assert_eq!(fit_power_law(&[(2.0, 1.0), (2.0, 3.0), (-1.0, 4.0), (f64::NAN, 1.0)]), None);
        assert_eq!(fit_power_law(&[]), None);
    }

    #[test]
    fn the_frontier_only_rises() {
        let points = [(5.0, 1.0), (1.0, 2.0), (3.0, 4.0), (2.0, 1.0), (3.0, 3.0), (4.0, 4.0), (f64::NAN, 9.0)];
        assert_eq!(pareto_frontier(&points), [(1.0, 2.0), (3.0, 4.0)]);
    }
}
