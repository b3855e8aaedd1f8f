//! The cameras that every procedural scene is seen with, laid out as for NeRF's synthetic scenes.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::Camera;
use crate::camera::look_along;

/// Training views of a procedural scene.
pub const TRAIN_VIEWS: usize = 100;
/// Test views of a procedural scene.
pub const TEST_VIEWS: usize = 200;
/// Distance of every camera from the origin, scene units.
pub(super) const RADIUS: f64 = 4.031_128_874;
/// Horizontal field of view, radians.
pub(crate) const FOV_X: f64 = 0.691_111_2;
/// Seed of the training poses: of the first 20,000 the one with which the five published four-view
/// sets (see [`crate::ViewSelection::Seed`]) are spread most, no two views of a set being less than
/// 46° apart. With a typical seed some set has two views of one side and so in effect three.
const SEED: u64 = 1590;

/// The [`TRAIN_VIEWS`] training cameras for `size`² images: at random on the upper hemisphere
/// (elevations 3° to 80°, uniform by area, from a fixed seed), looking at the origin.
pub fn train_cameras(size: u32) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let (low, high) = (3f64.to_radians().sin(), 80f64.to_radians().sin());
    (0..TRAIN_VIEWS)
        .map(|_| {
            let azimuth = TAU * rng.random::<f64>();
            let height: f64 = low + (high - low) * rng.random::<f64>();
            camera(size, azimuth, height.asin())
        })
        .collect()
}

/// The [`TEST_VIEWS`] test cameras for `size`² images: once around, while the elevation swings
/// between 10° and 60°, looking at the origin.
pub fn test_cameras(size: u32) -> Vec<Camera> {
    (0..TEST_VIEWS)
        .map(|i| {
            let turn = i as f64 / TEST_VIEWS as f64;
            let elevation = (35.0 + 25.0 * (TAU * turn).cos()) * PI / 180.0;
            camera(size, 0.5 * PI + TAU * turn, elevation)
        })
        .collect()
}

fn camera(size: u32, azimuth: f64, elevation: f64) -> Camera {
    let (sin, cos) = elevation.sin_cos();
    let direction = DVec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin);
    Camera::from_fov(size, size, FOV_X, look_along(RADIUS * direction, -direction, DVec3::Z))
}
