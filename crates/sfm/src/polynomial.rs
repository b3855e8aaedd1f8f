//! Real roots of polynomials.

/// Returns `Σ cᵢ xⁱ`.
pub(crate) fn evaluate(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Returns the product of two polynomials, coefficients ascending.
pub(crate) fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}

/// Returns the real roots where the polynomial `Σ cᵢ xⁱ` changes its sign, ascending: between two extrema, which are
/// roots of the derivative, there is at most one.
pub(crate) fn real_roots(coefficients: &[f64]) -> Vec<f64> {
    let largest = coefficients.iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    let Some(degree) = coefficients.iter().rposition(|c| c.abs() > 1e-14 * largest) else { return Vec::new() };
    let c = &coefficients[..=degree];
    match degree {
        0 => return Vec::new(),
        1 => return vec![-c[0] / c[1]],
        _ => {}
    }
    let derivative: Vec<f64> = c.iter().enumerate().skip(1).map(|(i, c)| i as f64 * c).collect();
    // Cauchy's bound on the roots.
    let bound = 1.0 + c[..degree].iter().fold(0.0, |m: f64, v| m.max((v / c[degree]).abs()));
    let mut ends = vec![-bound];
    ends.extend(real_roots(&derivative).into_iter().filter(|x| x.abs() < bound));
    ends.push(bound);
    ends.windows(2).filter_map(|w| root_between(c, &derivative, w[0], w[1])).collect()
}

/// Finds the root in a bracket by Newton's method, bisecting where it leaves the bracket or converges slowly.
fn root_between(c: &[f64], derivative: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let (at_low, at_high) = (evaluate(c, low), evaluate(c, high));
    if at_low == 0.0 {
        return Some(low);
    }
    if at_low.signum() == at_high.signum() {
        return None;
    }
    let mut x = 0.5 * (low + high);
    let mut step = high - low;
    for _ in 0..200 {
        let value = evaluate(c, x);
        if value.signum() == at_low.signum() {
            low = x
        } else {
            high = x
        }
        let newton = value / evaluate(derivative, x);
        let far = !(x - newton > low && x - newton < high) || 2.0 * newton.abs() > step.abs();
        let next = if far { 0.5 * (low + high) } else { x - newton };
        step = next - x;
        if value == 0.0 || step.abs() <= 1e-15 * x.abs() {
            break;
        }
        x = next;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_of_products() {
        let roots = [-31.0, -2.5, -1e-3, 0.0, 0.4, 0.41, 7.0, 1e3];
        let mut c = roots.iter().fold(vec![2.0], |c, r| product(&c, &[-r, 1.0]));
        // No further real root, and leading zeros.
        c = product(&c, &[5.0, 1.0, 1.0]);
        c.extend([0.0, 0.0]);
        let found = real_roots(&c);
        assert_eq!(found.len(), roots.len(), "{found:?}");
        for (a, b) in found.iter().zip(roots) {
            assert!((a - b).abs() < 1e-7 * (1.0 + b.abs()), "{a} {b}");
        }
        assert!(real_roots(&[1.0, 0.0, 1.0]).is_empty() && real_roots(&[3.0]).is_empty() && real_roots(&[]).is_empty());
    }
}
