//! Closed camera paths for videos.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat4, DVec3};

use super::ViewRegion;
use crate::Camera;

/// Returns `n` camera-to-world poses, evenly spaced along a closed path about the scene.
///
/// Cameras that surround a scene (or a single one) give a full circle about the up direction at
/// their mean distance and mean elevation, starting at the first camera's azimuth. Several cameras
/// within 26° of their mean direction, as in a forward-facing capture, give a small circle about
/// that direction at 0.7 of the greatest angle instead: from behind there is nothing to see.
pub fn orbit(cameras: &[Camera], n: usize) -> Vec<DMat4> {
    let region = ViewRegion::new(cameras);
    let (axis, half_angle) = region.cap();
    let radius = 0.5 * (region.radii().0 + region.radii().1);
    let turn = |i: usize| TAU * i as f64 / n as f64;

    if region.faces_forward() {
        let side = region.up().cross(axis).normalize_or(axis.any_orthonormal_vector());
        let top = axis.cross(side);
        let (sin, cos) = (0.7 * half_angle).sin_cos();
        let direction = |a: f64| cos * axis + sin * (a.cos() * side + a.sin() * top);
        return (0..n).map(|i| region.pose(direction(turn(i)), radius)).collect();
    }

    let level = OrbitAngles::of(&region);
    (0..n).map(|i| region.pose(level.direction(turn(i), level.elevation), radius)).collect()
}

/// Returns `n` camera-to-world poses, evenly spaced along a figure eight that lies on its side, twice as wide as high,
/// all at the mean distance.
///
/// With the angle θ along it, cameras that face one way swing about their mean direction by `(a sin θ, ½ a sin 2θ)`, a
/// being 0.7 of their greatest angle to it. Around an object azimuth and elevation swing by as much about the first camera's
/// azimuth and the mean elevation, with a = 0.6 (34°), and never over the top.
pub fn figure_eight(cameras: &[Camera], n: usize) -> Vec<DMat4> {
    let region = ViewRegion::new(cameras);
    let (axis, half_angle) = region.cap();
    let radius = 0.5 * (region.radii().0 + region.radii().1);
    let swing = |i: usize, width: f64, height: f64| {
        let angle = TAU * i as f64 / n as f64;
        (width * angle.sin(), height * (2.0 * angle).sin())
    };
    if region.faces_forward() {
        let side = region.up().cross(axis).normalize_or(axis.any_orthonormal_vector());
        let top = axis.cross(side);
        let width = 0.7 * half_angle;
        let direction = |(x, y): (f64, f64)| (axis + x.tan() * side + y.tan() * top).normalize();
        return (0..n).map(|i| region.pose(direction(swing(i, width, 0.5 * width)), radius)).collect();
    }
    let level = OrbitAngles::of(&region);
    let room = (FRAC_PI_2 - TOP - level.elevation.abs()).max(0.0);
    let pose = |(azimuth, height): (f64, f64)| region.pose(level.direction(azimuth, level.elevation + height), radius);
    (0..n).map(|i| pose(swing(i, SWING, (0.5 * SWING).min(room)))).collect()
}

/// Amplitude of a figure eight around an object, radians.
const SWING: f64 = 0.6;
/// Least angle between a figure eight and the point straight above the scene, radians.
const TOP: f64 = 0.15;

/// Azimuth and elevation about a scene: 0 is the first camera's azimuth.
struct OrbitAngles {
    start: DVec3,
    side: DVec3,
    up: DVec3,
    /// The mean elevation of the cameras.
    elevation: f64,
}

impl OrbitAngles {
    fn of(region: &ViewRegion) -> Self {
        let (up, directions) = (region.up(), region.directions());
        let count = directions.len() as f64;
        let elevation = directions.iter().map(|d| d.dot(up).clamp(-1.0, 1.0).asin()).sum::<f64>() / count;
        let level = |d: DVec3| d - up * d.dot(up);
        let start = directions.first().map_or(DVec3::X, |&d| level(d)).normalize_or(up.any_orthonormal_vector());
        Self { start, side: up.cross(start), up, elevation }
    }

    fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        let ((s, c), (sin, cos)) = (azimuth.sin_cos(), elevation.sin_cos());
        cos * (c * self.start + s * self.side) + sin * self.up
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{forward_cameras, train_cameras};

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
        assert!(orbit(&forward_cameras(), 12).iter().all(|p| p.z_axis.z > 0.9), "forward");
        assert_eq!((orbit(&[], 0).len(), orbit(&[], 3).len()), (0, 3));
    }

    #[test]
    fn a_figure_eight_crosses_itself_once() {
        let cameras = train_cameras(8);
        let path = figure_eight(&cameras, 8);
        let [start, crossing] = [0, 4].map(|i| path[i].w_axis);
        assert!((start - crossing).length() < 1e-9);
        let distinct = path.iter().filter(|pose| (pose.w_axis - start).length() > 1e-3).count();
        assert_eq!(distinct, 6);
        for pose in path {
            let position = pose.w_axis.truncate();
            assert!((position.length() - 4.0311).abs() < 1e-3 && pose.y_axis.z > 0.0);
            assert!((-pose.z_axis.truncate()).dot(-position.normalize()) > 1.0 - 1e-6);
        }
        assert!(figure_eight(&forward_cameras(), 12).iter().all(|pose| pose.z_axis.z > 0.98));
        assert!(figure_eight(&[], 3).iter().all(|pose| pose.is_finite()));
    }
}
