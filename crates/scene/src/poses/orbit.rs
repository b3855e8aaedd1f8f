//! Closed camera paths for films.

use std::f64::consts::TAU;

use glam::{DMat4, DVec3};

use super::ViewRegion;
use crate::Camera;

/// Cameras within this half-angle (radians) of their mean direction are taken to face one way.
pub(crate) const FORWARD_FACING: f64 = 0.45;

/// `n` camera-to-world poses, evenly spaced along a closed path about the scene.
///
/// Cameras that surround a scene (or a single one) give a full circle about the up direction at
/// their mean distance and mean elevation, starting at the first camera's azimuth. Several cameras
/// within 26° of their mean direction, as in a forward-facing capture, give a small circle about
/// that direction at 0.7 of the greatest angle instead: from behind there is nothing to see.
pub fn orbit(cameras: &[Camera], n: usize) -> Vec<DMat4> {
    let region = ViewRegion::new(cameras);
    let directions = region.directions();
    let (axis, half_angle) = region.cap();
    let radius = 0.5 * (region.radii().0 + region.radii().1);
    let turn = |i: usize| TAU * i as f64 / n as f64;

    if directions.len() > 1 && half_angle < FORWARD_FACING {
        let side = region.up().cross(axis).normalize_or(axis.any_orthonormal_vector());
        let top = axis.cross(side);
        let (sin, cos) = (0.7 * half_angle).sin_cos();
        let direction = |a: f64| cos * axis + sin * (a.cos() * side + a.sin() * top);
        return (0..n).map(|i| region.pose(direction(turn(i)), radius)).collect();
    }

    let up = region.up();
    let count = directions.len() as f64;
    let elevation = directions.iter().map(|d| d.dot(up).clamp(-1.0, 1.0).asin()).sum::<f64>() / count;
    let level = |d: DVec3| d - up * d.dot(up);
    let start = directions.first().map_or(DVec3::X, |&d| level(d)).normalize_or(up.any_orthonormal_vector());
    let side = up.cross(start);
    let (sin, cos) = elevation.sin_cos();
    (0..n)
        .map(|i| {
            let (s, c) = turn(i).sin_cos();
            region.pose(cos * (c * start + s * side) + sin * up, radius)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::look_along;
    use crate::procedural::train_cameras;

    #[test]
    fn object_orbit_is_level_and_closed() {
        let cameras = train_cameras(8);
        let path = orbit(&cameras, 8);
        assert_eq!(path.len(), 8);
        let heights: Vec<_> = path.iter().map(|p| p.w_axis.z).collect();
        assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-3 && *z > 0.5));
        let sum: DVec3 = path.iter().map(|p| p.w_axis.truncate()).sum();
        assert!(sum.x.abs() < 1e-2 && sum.y.abs() < 1e-2);
        for pose in path {
            let forward = -pose.z_axis.truncate();
            let to_centre = -pose.w_axis.truncate().normalize();
            assert!(forward.dot(to_centre) > 1.0 - 1e-6);
        }
    }

    #[test]
    fn forward_facing_orbit_keeps_facing_forward() {
        let cameras: Vec<_> = (0..6)
            .map(|i| {
                let p = DVec3::new(f64::from(i % 3) - 1.0, f64::from(i / 3) - 0.5, 0.0);
                let forward = DVec3::new(0.0, 0.0, -10.0) - p;
                Camera::from_fov(8, 8, 0.7, look_along(p, forward, DVec3::Y))
            })
            .collect();
        assert!(orbit(&cameras, 12).iter().all(|p| p.z_axis.z > 0.9));
    }

    #[test]
    fn empty_and_single() {
        assert!(orbit(&[], 0).is_empty());
        assert_eq!(orbit(&[], 3).len(), 3);
        assert!(orbit(&train_cameras(8)[..1], 5).iter().all(|p| p.is_finite()));
    }
}
