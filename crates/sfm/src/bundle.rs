//! Bundle adjustment (Triggs et al. 2000): Levenberg–Marquardt on lens, poses and points, which Schur's complement eliminates.

use std::iter::successors;

use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{DMatrix, DVector};

use crate::camera::{Pose, SimpleRadial};

/// Number of parameters of the lens: `ln focal` and `k1`.
const LENS: usize = 2;
const POSE: usize = 6;
/// Residual of a point behind the camera, as a multiple of the robust scale.
const MAX_RESIDUAL: f64 = 100.0;

/// A point and the pixels at which cameras, by index, see it.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// World coordinates.
    pub position: DVec3,
    /// Index of each camera that sees the point, and the pixel.
    pub seen: Vec<(usize, DVec2)>,
}

/// Prior of the lens: `ln focal` and `k1` as normal distributions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    pub(crate) focal: f64,
    /// Deviation of `ln focal`; 0 keeps the focal length.
    pub(crate) focal_deviation: f64,
    /// Deviation of `k1` around 0; 0 keeps it.
    pub(crate) k1_deviation: f64,
}

/// Prior of the poses: normal distributions of their orientations and positions.
#[derive(Clone, Debug)]
pub(crate) struct PosePrior {
    pub(crate) poses: Vec<Pose>,
    /// Deviation of orientations, radians.
    pub(crate) turn_deviation: f64,
    /// Deviation of positions, units of the world.
    pub(crate) shift_deviation: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct Bundle {
    pub(crate) lens: SimpleRadial,
    pub(crate) poses: Vec<Pose>,
    pub(crate) points: Vec<Point>,
}

pub(crate) struct Adjustment<'a> {
    pub(crate) prior: Prior,
    pub(crate) poses: Option<&'a PosePrior>,
    pub(crate) points: bool,
    /// Scale s of Cauchy's loss in pixels: residuals far above it lose their weight.
    pub(crate) scale: f64,
    pub(crate) steps: usize,
}

/// Normal equations: dense for lens and poses, with a 3×3 block for each point.
struct Normal {
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    points: Vec<PointBlock>,
}

struct PointBlock {
    matrix: DMat3,
    gradient: DVec3,
    /// Rows of the coupling to lens and poses: index of the parameter, and second derivatives.
    rows: Vec<(usize, DVec3)>,
}

impl Bundle {
    /// Minimises `Σ s² ln(1 + |r|²/s²)` of the residuals r in pixels, plus the prior, over the free parameters.
    pub(crate) fn adjust(&mut self, how: &Adjustment) {
        let mut damping = 1e-4;
        let mut cost = self.cost(how);
        for _ in 0..how.steps {
            let normal = self.linearised(how);
            let mut tried = successors(Some(damping), |damping| Some(damping * 10.0)).take_while(|it| *it < 1e8);
            let improved = tried.find_map(|damping| {
                let next = self.stepped(&normal, how, damping)?;
                let at = next.cost(how);
                (at < cost).then_some((next, at, damping))
            });
            let Some((next, at, tried)) = improved else { break };
            let gain = (cost - at) / cost;
            (*self, cost, damping) = (next, at, (tried * 0.1).max(1e-10));
            if gain < 1e-7 {
                break;
            }
        }
    }

    fn cost(&self, how: &Adjustment) -> f64 {
        let max_residual = MAX_RESIDUAL * how.scale;
        let robust = |r: f64| how.scale.powi(2) * (1.0 + (r.min(max_residual) / how.scale).powi(2)).ln();
        let seen = self.points.iter().flat_map(|point| point.seen.iter().map(move |seen| (point.position, seen)));
        let errors = seen.map(|(position, (camera, pixel))| {
            let projected = self.lens.project(self.poses[*camera].transform(position));
            projected.map_or(f64::INFINITY, |p| p.distance(*pixel))
        });
        let [focal, k1] = how.prior.residuals(&self.lens);
        let residuals = how.poses.iter().flat_map(|prior| prior.residuals(&self.poses)).flatten();
        let poses: f64 = residuals.map(DVec3::length_squared).sum();
        errors.map(robust).sum::<f64>() + focal.powi(2) + k1.powi(2) + poses
    }

    fn linearised(&self, how: &Adjustment) -> Normal {
        let size = LENS + POSE * self.poses.len();
        let (matrix, gradient) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let mut normal = Normal { matrix, gradient, points: Vec::new() };
        let deviations = [how.prior.focal_deviation, how.prior.k1_deviation];
        let residuals = how.prior.residuals(&self.lens);
        for i in (0..LENS).filter(|i| deviations[*i] > 0.0) {
            normal.matrix[(i, i)] += deviations[i].powi(-2);
            normal.gradient[i] += residuals[i] / deviations[i];
        }
        if let Some(prior) = how.poses {
            prior.add_to(&mut normal, &self.poses);
        }
        for point in &self.points {
            let mut block = PointBlock { matrix: DMat3::ZERO, gradient: DVec3::ZERO, rows: Vec::new() };
            let mut of_lens = [DVec3::ZERO; LENS];
            for &(camera, pixel) in &point.seen {
                let Some((projected, jacobian)) = derivative(&self.lens, &self.poses[camera], point.position) else {
                    continue;
                };
                let residual = projected - pixel;
                let weight = 1.0 / (1.0 + residual.length_squared() / how.scale.powi(2));
                let index = |k: usize| if k < LENS { k } else { LENS + POSE * camera + k - LENS };
                let free = |k: usize| k >= LENS || deviations[k] > 0.0;
                let mut coupling = [DVec3::ZERO; LENS + POSE];
                for (axis, row) in jacobian.iter().enumerate() {
                    let r = residual[axis] * weight;
                    for i in (0..LENS + POSE).filter(|i| free(*i)) {
                        normal.gradient[index(i)] += row.camera[i] * r;
                        coupling[i] += row.point * (row.camera[i] * weight);
                        for j in (0..LENS + POSE).filter(|j| free(*j)) {
                            normal.matrix[(index(i), index(j))] += row.camera[i] * row.camera[j] * weight;
                        }
                    }
                    block.gradient += row.point * r;
                    let p = row.point * weight;
                    block.matrix += DMat3::from_cols(row.point * p.x, row.point * p.y, row.point * p.z);
                }
                of_lens.iter_mut().zip(coupling).for_each(|(sum, c)| *sum += c);
                block.rows.extend((LENS..LENS + POSE).map(|k| (index(k), coupling[k])));
            }
            block.rows.extend(of_lens.into_iter().enumerate());
            normal.points.push(block);
        }
        normal
    }

    /// Returns the bundle after one damped step; `None` if the system is singular.
    fn stepped(&self, normal: &Normal, how: &Adjustment, damping: f64) -> Option<Self> {
        let (mut matrix, mut right) = (normal.matrix.clone(), -&normal.gradient);
        for i in 0..right.len() {
            let d = &mut matrix[(i, i)];
            *d = if *d > 0.0 { *d * (1.0 + damping) + 1e-12 } else { 1.0 };
        }
        let mut inverses = Vec::new();
        if how.points {
            for block in &normal.points {
                let diagonal = DVec3::new(block.matrix.x_axis.x, block.matrix.y_axis.y, block.matrix.z_axis.z);
                let damped = block.matrix + DMat3::from_diagonal(diagonal * damping + 1e-12);
                let inverse = damped.inverse();
                if !inverse.is_finite() {
                    return None;
                }
                let solved = inverse * block.gradient;
                for &(i, row) in &block.rows {
                    right[i] += row.dot(solved);
                    let weighted = inverse * row;
                    for &(j, other) in block.rows.iter().filter(|(j, _)| *j <= i) {
                        matrix[(i, j)] -= weighted.dot(other);
                    }
                }
                inverses.push(inverse);
            }
        }
        // Only the lower triangle is read.
        let step = matrix.cholesky()?.solve(&right);
        let mut next = self.clone();
        next.lens.focal *= step[0].exp();
        next.lens.k1 += step[1];
        for (i, pose) in next.poses.iter_mut().enumerate() {
            let at = |k: usize| step[LENS + POSE * i + k];
            *pose = pose.moved(DVec3::new(at(0), at(1), at(2)), DVec3::new(at(3), at(4), at(5)));
        }
        for ((point, block), inverse) in next.points.iter_mut().zip(&normal.points).zip(inverses) {
            let coupled: DVec3 = block.rows.iter().map(|&(i, row)| row * step[i]).sum();
            point.position -= inverse * (block.gradient + coupled);
        }
        Some(next)
    }
}

impl Prior {
    pub(crate) fn fixed(lens: &SimpleRadial) -> Self {
        Self { focal: lens.focal, focal_deviation: 0.0, k1_deviation: 0.0 }
    }

    /// Returns `ln (focal / expected)` and `k1`, each divided by its deviation, or 0 for a parameter that is kept.
    fn residuals(&self, lens: &SimpleRadial) -> [f64; LENS] {
        let over = |value: f64, deviation: f64| if deviation > 0.0 { value / deviation } else { 0.0 };
        [over((lens.focal / self.focal).ln(), self.focal_deviation), over(lens.k1, self.k1_deviation)]
    }
}

impl PosePrior {
    /// Returns each camera's rotation `log(R R₀ᵀ)` and shift `R (c₀ - c)` from its expected pose, divided by the deviations.
    fn residuals(&self, poses: &[Pose]) -> impl Iterator<Item = [DVec3; 2]> {
        self.poses.iter().zip(poses).map(|(expected, pose)| {
            let turn = DQuat::from_mat3(&(pose.rotation * expected.rotation.transpose())).to_scaled_axis();
            [turn / self.turn_deviation, pose.transform(expected.centre()) / self.shift_deviation]
        })
    }

    /// Adds the prior to the normal equations. Rotations are small: the identity approximates their derivative.
    fn add_to(&self, normal: &mut Normal, poses: &[Pose]) {
        for (camera, residuals) in self.residuals(poses).enumerate() {
            let lever = poses[camera].rotation * self.poses[camera].centre() / self.shift_deviation;
            for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
                let of_turn = [unit / self.turn_deviation, DVec3::ZERO];
                // `R (c₀ - c) = R c₀ + t` changes by `ω × R c₀ + shift` with the pose.
                let of_shift = [lever.cross(unit), unit / self.shift_deviation];
                for (row, residual) in [of_turn, of_shift].iter().zip(residuals.map(|r| r[axis])) {
                    let (row, first) = (row.map(|part| part.to_array()), LENS + POSE * camera);
                    let row = row.as_flattened();
                    for i in 0..POSE {
                        normal.gradient[first + i] += row[i] * residual;
                        for j in 0..POSE {
                            normal.matrix[(first + i, first + j)] += row[i] * row[j];
                        }
                    }
                }
            }
        }
    }
}

struct PixelDerivative {
    /// Derivatives by `ln focal`, `k1`, the turn of the camera and its shift.
    camera: [f64; LENS + POSE],
    point: DVec3,
}

/// Projects a point, with the derivative of the pixel; `None` behind the camera.
fn derivative(lens: &SimpleRadial, pose: &Pose, point: DVec3) -> Option<(DVec2, [PixelDerivative; 2])> {
    let turned = pose.rotation * point;
    let at = turned + pose.translation;
    let pixel = lens.project(at)?;
    let p = at.truncate() / at.z;
    let (radius2, unit) = (p.length_squared(), DVec2::AXES);
    let row = |axis: usize| {
        // Derivatives by p, then by the point in the camera's axes.
        let by_p = lens.focal * ((1.0 + lens.k1 * radius2) * unit[axis] + 2.0 * lens.k1 * p[axis] * p);
        let shift = DVec3::new(by_p.x, by_p.y, -by_p.dot(p)) / at.z;
        let turn = turned.cross(shift);
        let by_focal = (pixel - lens.centre)[axis];
        let by_k1 = lens.focal * radius2 * p[axis];
        let camera = [by_focal, by_k1, turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        PixelDerivative { camera, point: pose.rotation.transpose() * shift }
    };
    Some((pixel, [row(0), row(1)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::world;

    /// Compares the gradient by the lens, all poses and all points with differences of half the cost. The rotations are those
    /// expected, at which the prior's derivative is exact.
    #[test]
    fn the_gradient_is_that_of_half_the_cost() {
        let mut all = world(3, 2, 5);
        for (i, (_, pixel)) in all.points.iter_mut().flat_map(|point| &mut point.seen).enumerate() {
            *pixel += 2.0 * DVec2::new((i as f64).sin(), (i as f64).cos());
        }
        let prior = Prior { focal: 0.9 * all.lens.focal, focal_deviation: 0.1, k1_deviation: 0.05 };
        let poses = all.poses.iter().map(|pose| pose.moved(DVec3::ZERO, DVec3::new(0.1, -0.2, 0.05))).collect();
        let expected = PosePrior { poses, turn_deviation: 0.1, shift_deviation: 0.25 };
        let how = Adjustment { prior, poses: Some(&expected), points: true, scale: 1.5, steps: 1 };
        let of_cameras = LENS + POSE * all.poses.len();
        let cost = |k: usize, h: f64| {
            let unit = |first: usize| DVec3::from_array(std::array::from_fn(|i| if first + i == k { h } else { 0.0 }));
            let mut moved = all.clone();
            moved.lens.focal *= unit(0).x.exp();
            moved.lens.k1 += unit(1).x;
            for (camera, pose) in moved.poses.iter_mut().enumerate() {
                let first = LENS + POSE * camera;
                *pose = pose.moved(unit(first), unit(first + 3));
            }
            moved.points.iter_mut().enumerate().for_each(|(i, point)| point.position += unit(of_cameras + 3 * i));
            moved.cost(&how)
        };
        let normal = all.linearised(&how);
        for k in 0..of_cameras + 3 * all.points.len() {
            let difference = (cost(k, 1e-6) - cost(k, -1e-6)) / 4e-6;
            let of_point = |at: usize| normal.points[at / 3].gradient[at % 3];
            let exact = if k < of_cameras { normal.gradient[k] } else { of_point(k - of_cameras) };
            assert!((exact - difference).abs() < 1e-4 * (1.0 + exact.abs()), "{k}: {exact} {difference}");
        }
    }

    #[test]
    fn the_cost_adds_what_priors_and_observations_disagree() {
        let mut all = world(3, 2, 5);
        let exact = Prior { focal: all.lens.focal, focal_deviation: 0.1, k1_deviation: 0.05 };
        all.lens.k1 = 0.0;
        all.points.iter_mut().for_each(|point| point.seen.clear());
        let cost = |bundle: &Bundle, prior: Prior, poses: Option<&PosePrior>| {
            bundle.cost(&Adjustment { prior, poses, points: true, scale: 1.0, steps: 1 })
        };
        assert_eq!(cost(&all, exact, None), 0.0);
        let longer = Prior { focal: all.lens.focal / 0.2f64.exp(), ..exact };
        all.lens.k1 = 0.15;
        assert!((cost(&all, exact, None) - 9.0).abs() < 1e-9);
        assert!((cost(&all, longer, None) - 13.0).abs() < 1e-9, "(0.2 / 0.1)² + (0.15 / 0.05)²");
        let moved = all.poses.iter().map(|pose| pose.moved(DVec3::ZERO, DVec3::X * 0.5)).collect();
        let expected = PosePrior { poses: moved, turn_deviation: 0.1, shift_deviation: 0.25 };
        assert!((cost(&all, longer, Some(&expected)) - 21.0).abs() < 1e-9, "and 2 · (0.5 / 0.25)²");
        let exact = all.lens.project(all.poses[0].transform(all.points[0].position)).unwrap();
        all.points[0].seen = vec![(0, exact + 2.0 * DVec2::X)];
        assert!((cost(&all, longer, Some(&expected)) - 21.0 - 5f64.ln()).abs() < 1e-9);
    }
}
