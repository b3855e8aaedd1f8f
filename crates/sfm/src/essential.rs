//! Essential matrices: the five-point method (Nistér 2004), Sampson's error, poses.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{Matrix3, SMatrix};

use crate::camera::Pose;
use crate::p3p::{evaluate, product, real_roots};

/// Monomials by their exponents of x, y, z, a hexadecimal digit each. The first ten are eliminated in this order.
const MONOMIALS: [u16; 20] = [
    0x300, 0x030, 0x210, 0x120, 0x201, 0x200, 0x021, 0x020, 0x111, 0x110, 0x102, 0x101, 0x100, 0x012, 0x011, 0x010,
    0x003, 0x002, 0x001, 0x000,
];

/// Coefficients of [`MONOMIALS`]: a polynomial of degree 3 in x, y, z.
type Cubic = [f64; 20];

fn times(a: &Cubic, b: &Cubic) -> Cubic {
    let mut out = [0.0; 20];
    for (i, &x) in a.iter().enumerate().filter(|(_, x)| **x != 0.0) {
        for (j, &y) in b.iter().enumerate().filter(|(_, y)| **y != 0.0) {
            if let Some(k) = MONOMIALS.iter().position(|m| *m == MONOMIALS[i] + MONOMIALS[j]) {
                out[k] += x * y;
            }
        }
    }
    out
}

fn sum(terms: impl IntoIterator<Item = (f64, Cubic)>) -> Cubic {
    let mut out = [0.0; 20];
    for (factor, term) in terms {
        out.iter_mut().zip(term).for_each(|(o, t)| *o += factor * t);
    }
    out
}

/// Solves for the at most ten matrices with `bᵀ E a = 0` for five pairs of directions `(x, y, 1)`, `det E = 0` and
/// `2 E Eᵀ E = tr(E Eᵀ) E`. Empty if the pairs are degenerate.
pub(crate) fn five_point(pairs: [(DVec2, DVec2); 5]) -> Vec<DMat3> {
    // Columns 5 to 8 of Q in `[Aᵀ | B] = Q R`, with any B, are orthogonal to the five equations.
    let mut columns = SMatrix::<f64, 9, 9>::identity();
    for (i, (a, b)) in pairs.iter().enumerate() {
        let (a, b) = (a.extend(1.0).to_array(), b.extend(1.0).to_array());
        columns.set_column(i, &SMatrix::<f64, 9, 1>::from_fn(|k, _| b[k / 3] * a[k % 3]));
    }
    for i in 5..9 {
        columns.set_column(i, &SMatrix::<f64, 9, 1>::from_fn(|k, _| f64::from((k * 7 + i * 5) as u32 % 11) - 5.0));
    }
    let q = columns.qr().q();
    // E = x X + y Y + z Z + W.
    let e: [Cubic; 9] = std::array::from_fn(|k| {
        let mut linear = [0.0; 20];
        for (i, at) in [12, 15, 18, 19].into_iter().enumerate() {
            linear[at] = q[(k, 5 + i)];
        }
        linear
    });
    let entry = |r: usize, c: usize| &e[3 * r + c];
    let dot = |r: usize, c: usize| sum((0..3).map(|k| (1.0, times(entry(r, k), entry(c, k)))));
    let square: [[Cubic; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| dot(r, c)));
    let trace = sum((0..3).map(|i| (1.0, square[i][i])));
    let mut m = SMatrix::<f64, 10, 20>::zeros();
    for (r, row) in square.iter().enumerate() {
        for c in 0..3 {
            let cubic = (0..3).map(|k| (2.0, times(&row[k], entry(k, c))));
            let equation = sum(cubic.chain([(-1.0, times(&trace, entry(r, c)))]));
            m.set_row(3 * r + c, &equation.into());
        }
    }
    let minor =
        |a: usize, b: usize| sum([(1.0, times(entry(1, a), entry(2, b))), (-1.0, times(entry(1, b), entry(2, a)))]);
    let det = (0..3).map(|i| (1.0, times(entry(0, i), &minor((i + 1) % 3, (i + 2) % 3))));
    m.set_row(9, &sum(det).into());
    let (eliminated, rest) = (m.fixed_columns::<10>(0).into_owned(), m.fixed_columns::<10>(10).into_owned());
    let Some(solved) = eliminated.lu().solve(&rest) else { return Vec::new() };
    // Rows for x²z, y²z, xyz minus z times rows for x², y², xy: equations `p x + q y + r = 0` with p, q, r in z.
    let rows: [[Vec<f64>; 3]; 3] = std::array::from_fn(|i| {
        let (a, b) = (solved.row(4 + 2 * i), solved.row(5 + 2 * i));
        let part = |first: usize, count: usize| {
            let high = (0..=count).map(|k| if k < count { a[first + count - 1 - k] } else { 0.0 });
            let low = (0..=count).map(|k| if k > 0 { b[first + count - k] } else { 0.0 });
            high.zip(low).map(|(a, b)| a - b).collect::<Vec<f64>>()
        };
        [part(0, 3), part(3, 3), part(6, 4)]
    });
    let mut determinant = vec![0.0; 11];
    for (i, [j, k], sign) in
        [(0, [1, 2], 1.0), (0, [2, 1], -1.0), (1, [2, 0], 1.0), (1, [0, 2], -1.0), (2, [0, 1], 1.0), (2, [1, 0], -1.0)]
    {
        let term = product(&product(&rows[0][i], &rows[1][j]), &rows[2][k]);
        determinant.iter_mut().zip(term).for_each(|(d, t)| *d += sign * t);
    }
    let solution = |z: f64| {
        let at = rows.each_ref().map(|row| DVec3::from_array(row.each_ref().map(|p| evaluate(p, z))));
        let crosses = [at[0].cross(at[1]), at[1].cross(at[2]), at[2].cross(at[0])];
        let v = crosses.into_iter().max_by(|a, b| a.z.abs().total_cmp(&b.z.abs()))?;
        let weights = [v.x / v.z, v.y / v.z, z, 1.0];
        let e: [f64; 9] = std::array::from_fn(|k| (0..4).map(|i| weights[i] * q[(k, 5 + i)]).sum());
        let matrix = DMat3::from_cols_array(&e).transpose();
        matrix.is_finite().then_some(matrix)
    };
    real_roots(&determinant).into_iter().filter_map(solution).collect()
}

/// Returns Sampson's error: the squared distance, to first order, from a pair to the nearest one with `bᵀ E a = 0`.
pub(crate) fn sampson(e: &DMat3, (a, b): (DVec2, DVec2)) -> f64 {
    let (a, b) = (a.extend(1.0), b.extend(1.0));
    let (ea, eb) = (*e * a, e.transpose() * b);
    b.dot(ea).powi(2) / (ea.truncate().length_squared() + eb.truncate().length_squared())
}

/// Returns the four poses of the second camera that `e` allows; the first is at the origin, the baseline is 1.
pub(crate) fn poses(e: &DMat3) -> [Pose; 4] {
    let svd = Matrix3::from_column_slice(&e.to_cols_array()).svd(true, true);
    let matrix = |m: Option<Matrix3<f64>>| m.map_or(DMat3::IDENTITY, |m| DMat3::from_cols_slice(m.as_slice()));
    let (u, v) = (matrix(svd.u), matrix(svd.v_t).transpose());
    let w = DMat3::from_cols(-DVec3::Y, DVec3::X, DVec3::Z).transpose();
    let t = u.z_axis;
    let rotation = |w: DMat3| {
        let r = u * w * v.transpose();
        r * r.determinant().signum()
    };
    let turns = [rotation(w), rotation(w.transpose())];
    [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)].map(|(i, sign)| Pose { rotation: turns[i], translation: sign * t })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{turn, world};
    use crate::two_view::{cross, relative};

    #[test]
    fn five_exact_pairs_give_the_pose() {
        for seed in 0..50 {
            let all = world(seed, 2, 6);
            let pair = |i: usize| {
                let seen = &all.points[i].seen;
                (all.lens.unproject(seen[0].1), all.lens.unproject(seen[1].1))
            };
            let found = five_point(std::array::from_fn(pair));
            assert!((1..=10).contains(&found.len()));
            for e in &found {
                assert!((0..5).all(|i| sampson(e, pair(i)) < 1e-15), "seed {seed}");
            }
            let Pose { rotation, translation } = relative([&all.poses[0], &all.poses[1]]);
            let shift = translation.normalize();
            let error = |pose: &Pose| turn(&pose.rotation, &rotation).to_radians() + pose.translation.distance(shift);
            let least = found.iter().flat_map(poses).map(|pose| error(&pose)).fold(f64::INFINITY, f64::min);
            assert!(least < 1e-5, "seed {seed}: {least}");
        }
    }

    /// The sign of an essential matrix is arbitrary: both signs give the same poses, all of them rotations.
    #[test]
    fn poses_are_rotations_whatever_the_sign() {
        let e = DMat3::from_cols(DVec3::ZERO, DVec3::Z, -DVec3::Y) * DMat3::from_rotation_y(0.3);
        for matrix in [e, -1.0 * e] {
            let found = poses(&matrix);
            for pose in &found {
                assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12 && pose.translation.is_normalized());
                let again = cross(pose.translation) * pose.rotation;
                assert!(again.abs_diff_eq(e, 1e-9) || again.abs_diff_eq(-1.0 * e, 1e-9), "{again}");
            }
            assert!(found.iter().any(|pose| turn(&pose.rotation, &DMat3::from_rotation_y(0.3)) < 1e-4));
        }
    }
}
