//! Cameras for tests.

use std::f64::consts::TAU;

use glam::{DMat4, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::camera::{Camera, look_along};

/// Returns a camera at `position` that looks along `forward`, held level.
pub fn level_camera(position: DVec3, forward: DVec3) -> Camera {
    Camera::from_fov(8, 8, 0.7, look_along(position, forward, DVec3::Z))
}

/// Whether the camera at a pose looks at the origin.
pub fn looks_at_origin(pose: &DMat4) -> bool {
    pose.z_axis.truncate().dot(pose.w_axis.truncate().normalize()) > 1.0 - 1e-6
}

/// Returns a hundred cameras at random on the upper hemisphere about the origin, which they look at.
pub fn train_cameras() -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(1590);
    let (low, high) = (3f64.to_radians().sin(), 80f64.to_radians().sin());
    let mut camera = || {
        let azimuth = TAU * rng.random::<f64>();
        let height = low + (high - low) * rng.random::<f64>();
        let across = (1.0 - height * height).sqrt();
        let out = DVec3::new(across * azimuth.cos(), across * azimuth.sin(), height);
        Camera::from_fov(8, 8, 0.6911, look_along(4.0311 * out, -out, DVec3::Z))
    };
    (0..100).map(|_| camera()).collect()
}

/// Returns six cameras in two rows that look at a point ten units ahead.
pub fn forward_cameras() -> Vec<Camera> {
    let place = |i: u32| DVec3::new(f64::from(i % 3) - 1.0, f64::from(i / 3) - 0.5, 0.0);
    let pose = |p: DVec3| look_along(p, DVec3::NEG_Z * 10.0 - p, DVec3::Y);
    (0..6).map(|i| Camera::from_fov(8, 8, 0.7, pose(place(i)))).collect()
}
