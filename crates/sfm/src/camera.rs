//! Poses and the lens, and points from the views that see them.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use infonerf_scene::Camera;
use nalgebra::{Matrix3, Vector3};

/// Pose of a camera, world to camera: `x ↦ rotation · x + translation`; the camera looks along +z, y is down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World to camera.
    pub rotation: DMat3,
    /// The world's origin in the camera's axes.
    pub translation: DVec3,
}

impl Pose {
    /// Pose with the world's axes and origin.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// Converts a camera-to-world matrix with OpenGL's axes.
    pub fn of(to_world: &DMat4) -> Self {
        let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)) * DMat3::from_mat4(*to_world).transpose();
        Self { rotation, translation: -(rotation * to_world.w_axis.truncate()) }
    }

    /// Returns a point of the world in the camera's axes.
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Returns the position of the camera in the world.
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Turns the pose by the rotation vector `turn` about the camera, then moves it by `shift`, both in the camera's axes.
    pub(crate) fn moved(&self, turn: DVec3, shift: DVec3) -> Self {
        let rotation = DMat3::from_quat((DQuat::from_scaled_axis(turn) * DQuat::from_mat3(&self.rotation)).normalize());
        Self { rotation, translation: self.translation + shift }
    }
}

/// Returns `(x, y) / z` (x right, y down, z forward) of the ray through a pixel; `None` where the lens cannot be inverted.
pub fn ray(camera: &Camera, pixel: DVec2) -> Option<DVec2> {
    let (centre, focal) = (DVec2::new(camera.cx, camera.cy), DVec2::new(camera.fx, camera.fy));
    camera.lens.undistort((pixel - centre) / focal)
}

/// Lens with square pixels, the centre of the image, and one coefficient of radial distortion (COLMAP's SIMPLE_RADIAL):
/// `p = focal · (1 + k1 r²) · (x, y) / z + centre` with `r² = (x² + y²) / z²`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimpleRadial {
    /// Focal length in pixels.
    pub focal: f64,
    /// Coefficient of radial distortion.
    pub k1: f64,
    /// Principal point in pixels.
    pub centre: DVec2,
}

impl SimpleRadial {
    /// Returns the pixel at which a point in the camera's axes is seen; `None` behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = point.truncate() / point.z;
        (point.z > 0.0).then(|| self.focal * (1.0 + self.k1 * p.length_squared()) * p + self.centre)
    }

    /// Returns `(x, y) / z` of what is seen at `pixel`: inverts [`SimpleRadial::project`] by fixed-point iteration.
    pub fn unproject(&self, pixel: DVec2) -> DVec2 {
        let distorted = (pixel - self.centre) / self.focal;
        (0..20).fold(distorted, |p, _| distorted / (1.0 + self.k1 * p.length_squared()).max(0.1))
    }
}

/// Triangulates a point from rays `(x, y, 1)` in the cameras' axes: minimizes squared image errors by reweighted least
/// squares. `None` if the rays are parallel or the point is behind a camera.
pub(crate) fn triangulate(seen: &[(Pose, DVec2)]) -> Option<DVec3> {
    let mut depths = vec![1.0; seen.len()];
    let mut point = None;
    for _ in 0..4 {
        let (mut a, mut b) = (Matrix3::zeros(), Vector3::zeros());
        for ((pose, p), depth) in seen.iter().zip(&depths) {
            // Rows `x z' - x'` and `y z' - y'` of the point in the camera's axes, divided by the depth: image errors.
            let rows = pose.rotation.transpose();
            for (axis, offset, v) in [(rows.x_axis, pose.translation.x, p.x), (rows.y_axis, pose.translation.y, p.y)] {
                let normal = (rows.z_axis * v - axis) / *depth;
                let row = Vector3::new(normal.x, normal.y, normal.z);
                a += row * row.transpose();
                b += row * ((offset - pose.translation.z * v) / *depth);
            }
        }
        let x = a.cholesky()?.solve(&b);
        let found = DVec3::new(x.x, x.y, x.z);
        for ((pose, _), depth) in seen.iter().zip(&mut depths) {
            *depth = pose.transform(found).z;
        }
        if !found.is_finite() || depths.iter().any(|depth| *depth <= 0.0) {
            return None;
        }
        point = Some(found);
    }
    point
}

/// Returns the largest angle between the rays from two of `centres` to `point`, in radians.
pub(crate) fn angle(point: DVec3, centres: &[DVec3]) -> f64 {
    let pairs = centres.iter().enumerate().flat_map(|(i, a)| centres[..i].iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| (*a - point).angle_between(*b - point)).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{disturb, world};

    #[test]
    fn no_point_behind_a_camera_or_of_parallel_rays() {
        let beside = Pose { translation: DVec3::X, ..Pose::IDENTITY };
        let seen = |x: f64| triangulate(&[(Pose::IDENTITY, DVec2::ZERO), (beside, DVec2::new(x, 0.0))]);
        assert!(seen(0.2).unwrap().distance(DVec3::new(0.0, 0.0, 5.0)) < 1e-9);
        assert_eq!((seen(-0.2), seen(0.0)), (None, None));
        let right_angle = angle(DVec3::ZERO, &[DVec3::X, DVec3::Y, DVec3::X]);
        assert!((right_angle - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn points_are_found_from_what_is_seen() {
        let (exact, mut noisy) = (world(1, 4, 50), world(1, 4, 50));
        disturb(&mut noisy.points, 1.0, usize::MAX);
        let position = |all: &crate::bundle::Bundle, i: usize| {
            let view = |(camera, pixel): &(usize, DVec2)| (all.poses[*camera], all.lens.unproject(*pixel));
            triangulate(&all.points[i].seen.iter().map(view).collect::<Vec<_>>()).unwrap()
        };
        for (i, point) in exact.points.iter().enumerate() {
            assert!(position(&exact, i).distance(point.position) < 1e-5);
            assert!(position(&noisy, i).distance(point.position) < 0.05);
        }
    }
}
