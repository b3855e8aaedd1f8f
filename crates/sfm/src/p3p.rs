//! The pose from three points (Grunert 1841, as in Haralick et al. 1994), and real roots of polynomials.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::Pose;

/// Returns the at most four poses in which three points of the world are seen in the directions `(x, y, 1)`.
pub(crate) fn p3p(seen: [(DVec2, DVec3); 3]) -> Vec<Pose> {
    let rays = seen.map(|(pixel, _)| pixel.extend(1.0).normalize());
    let points = seen.map(|(_, point)| point);
    let side = |i: usize, j: usize| points[i].distance_squared(points[j]);
    let (a2, b2, c2) = (side(1, 2), side(0, 2), side(0, 1));
    let (cos_a, cos_b, cos_c) = (rays[1].dot(rays[2]), rays[0].dot(rays[2]), rays[0].dot(rays[1]));
    let (p, q, r) = ((a2 - c2) / b2, (a2 + c2) / b2, c2 / b2);
    if !(p + q + r).is_finite() {
        return Vec::new();
    }
    let (aa, bb, cc) = (cos_a * cos_a, cos_b * cos_b, cos_c * cos_c);
    let quartic = [
        (1.0 + p).powi(2) - 4.0 * a2 / b2 * cc,
        4.0 * (-p * (1.0 + p) * cos_b + 2.0 * a2 / b2 * cc * cos_b - (1.0 - q) * cos_a * cos_c),
        2.0 * (p * p - 1.0 + 2.0 * p * p * bb + 2.0 * (1.0 - r) * aa - 4.0 * q * cos_a * cos_b * cos_c
            + 2.0 * (1.0 - a2 / b2) * cc),
        4.0 * (p * (1.0 - p) * cos_b - (1.0 - q) * cos_a * cos_c + 2.0 * r * aa * cos_b),
        (p - 1.0).powi(2) - 4.0 * r * aa,
    ];
    let pose = |v: f64| {
        let u = ((p - 1.0) * v * v - 2.0 * p * cos_b * v + 1.0 + p) / (2.0 * (cos_c - v * cos_a));
        let nearest = (b2 / (1.0 + v * v - 2.0 * v * cos_b)).sqrt();
        let camera = [rays[0] * nearest, rays[1] * (u * nearest), rays[2] * (v * nearest)];
        let rotation = frame(camera)? * frame(points)?.transpose();
        let pose = Pose { rotation, translation: camera[0] - rotation * points[0] };
        (u > 0.0 && pose.translation.is_finite()).then_some(pose)
    };
    real_roots(&quartic).into_iter().filter(|v| *v > 0.0).filter_map(pose).collect()
}

/// Returns the axes of a triangle; `None` if it has no area.
fn frame([a, b, c]: [DVec3; 3]) -> Option<DMat3> {
    let x = (b - a).try_normalize()?;
    let z = x.cross(c - a).try_normalize()?;
    Some(DMat3::from_cols(x, z.cross(x), z))
}

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
    if degree < 2 {
        return if degree == 1 { vec![-c[0] / c[1]] } else { Vec::new() };
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
        (low, high) = if value.signum() == at_low.signum() { (x, high) } else { (low, x) };
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
    use crate::testing::world;

    #[test]
    fn three_exact_points_give_the_pose() {
        for seed in 0..100 {
            let all = world(seed, 1, 3);
            let seen = [0, 1, 2].map(|i| (all.lens.unproject(all.points[i].seen[0].1), all.points[i].position));
            let truth = all.poses[0];
            let error = |p: &Pose| {
                p.translation.distance(truth.translation) + p.rotation.x_axis.distance(truth.rotation.x_axis)
            };
            let least = p3p(seen).iter().map(error).fold(f64::INFINITY, f64::min);
            assert!(least < 1e-5, "seed {seed}: {least}");
        }
        let one = (DVec2::ZERO, DVec3::X);
        assert!(p3p([one, one, one]).is_empty());
    }

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
