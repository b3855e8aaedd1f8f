//! The cameras of procedural scenes: laid out as for NeRF's synthetic scenes, or as in a hand-held capture.

use std::f64::consts::{PI, TAU};
use std::hash::Hasher;

use fnv::FnvHasher;
use glam::DVec3;
use infonerf_scene::{Aabb, Camera, look_along};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{BOUNDS, CAPTURES, CLASSICS, FAR, NEAR};

pub(super) const TRAIN_VIEWS: usize = 100;
const TEST_VIEWS: usize = 200;
/// Distance of every camera from the origin, scene units.
pub(super) const RADIUS: f64 = 4.031_128_874;
/// Horizontal field of view, radians.
const FOV_X: f64 = 0.691_111_2;
/// Horizontal field of view in `room`, radians.
const ROOM_FOV_X: f64 = 0.95;
/// Number of cameras of a capture, training and test.
const CAPTURED: usize = 40;
/// Seed of the training poses: of the first 20,000 seeds the one that spreads the five published four-view sets (see
/// [`infonerf_scene::ViewSelection::Seed`]) most, no two views of a set being less than 46° apart. With a typical seed
/// some set has two views from nearly the same direction.
const SEED: u64 = 1590;

/// Returns the 100 training cameras for `size`² images: at random on the upper hemisphere
/// (elevations 3° to 80°, uniform by area, from a fixed seed), looking at the origin.
///
/// They are the cameras of castle, crane, knot, orrery and `random-<seed>`; see [`super::cameras()`] for all scenes.
pub fn train_cameras(size: u32) -> Vec<Camera> {
    hemisphere(SEED, size)
}

fn hemisphere(seed: u64, size: u32) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (low, high) = (3f64.to_radians().sin(), 80f64.to_radians().sin());
    let view = |_| {
        let azimuth = TAU * rng.random::<f64>();
        let height: f64 = low + (high - low) * rng.random::<f64>();
        camera(size, azimuth, height.asin())
    };
    (0..TRAIN_VIEWS).map(view).collect()
}

/// Returns the 200 test cameras for `size`² images: once around, at elevations from 10° to 60°, looking at the origin.
fn test_cameras(size: u32) -> Vec<Camera> {
    let view = |i: usize| {
        let turn = i as f64 / TEST_VIEWS as f64;
        let elevation = (35.0 + 25.0 * (TAU * turn).cos()) * PI / 180.0;
        camera(size, 0.5 * PI + TAU * turn, elevation)
    };
    (0..TEST_VIEWS).map(view).collect()
}

/// Returns the unit vector at these angles, radians.
fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    let (up, across) = elevation.sin_cos();
    DVec3::new(across * azimuth.cos(), across * azimuth.sin(), up)
}

/// Returns a camera at the radius of NeRF's synthetic scenes that looks at the origin.
fn camera(size: u32, azimuth: f64, elevation: f64) -> Camera {
    let direction = direction(azimuth, elevation);
    Camera::from_fov(size, size, FOV_X, look_along(RADIUS * direction, -direction, DVec3::Z))
}

/// The cameras of a scene, and its extent.
pub(super) struct SceneCameras {
    pub train: Vec<Camera>,
    pub test: Vec<Camera>,
    pub near: f32,
    pub far: f32,
    pub bounds: Aabb,
}

/// Returns the cameras of the scene `name`, which exists, for `size`² images.
pub(super) fn layout(name: &str, size: u32) -> SceneCameras {
    let capture = |near, far, min: [f32; 3], max: [f32; 3]| {
        // Every fourth camera, starting with the second, is for testing.
        let mut places = (0..4).cycle();
        let (test, train) = hand_held(name, size, CAPTURED).into_iter().partition(|_| places.next() == Some(1));
        SceneCameras { train, test, near, far, bounds: Aabb { min: min.into(), max: max.into() } }
    };
    let (train, test) = match name {
        "room" => return capture(0.4, 8.0, [-2.1, -1.1, -0.1], [2.1, 4.6, 2.9]),
        "table" => return capture(1.2, 9.0, [-4.3, -3.1, -1.2], [4.3, 2.7, 3.6]),
        "figure" => ring(size),
        _ if CLASSICS.contains(&name) || name.starts_with("random-") => (train_cameras(size), test_cameras(size)),
        _ => (hemisphere(fingerprint(name.as_bytes()), size), test_cameras(size)),
    };
    SceneCameras { train, test, near: NEAR, far: FAR, bounds: BOUNDS }
}

/// Returns at most `count` cameras of the scene `name`, which exists, for `size`² images, as for a set of photographs:
/// a capture has as many as asked for, any other scene only its training views.
pub fn photographs(name: &str, size: u32, count: usize) -> Vec<Camera> {
    let is_capture = CAPTURES.contains(&name);
    let mut cameras = if is_capture { hand_held(name, size, count) } else { layout(name, size).train };
    cameras.truncate(count);
    cameras
}

/// Returns the horizontal field of view of the cameras of the scene `name`, radians.
pub fn field_of_view(name: &str) -> f64 {
    if name == "room" { ROOM_FOV_X } else { FOV_X }
}

/// Returns the 64-bit FNV-1a hash of `bytes`. A scene's name is hashed to the seed of its cameras: none is chosen by hand.
pub(super) fn fingerprint(bytes: &[u8]) -> u64 {
    let mut hash = FnvHasher::default();
    hash.write(bytes);
    hash.finish()
}

/// Returns `count` hand-held cameras: at one end of `room`, looking at the other, or before `table` in an arc of 130°.
fn hand_held(name: &str, size: u32, count: usize) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(fingerprint(name.as_bytes()));
    let mut within = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
    let camera = |_| {
        let (at, target) = if name == "room" {
            let at = DVec3::new(within(0.8), -0.4 + within(0.3), 1.35 + within(0.4));
            (at, DVec3::new(within(0.35), 3.6, 0.95 + within(0.15)))
        } else {
            let azimuth = (-90.0 + within(65.0)).to_radians();
            let direction = direction(azimuth, (32.0 + within(16.0)).to_radians());
            let target = DVec3::new(within(0.1), within(0.1), -0.2 + within(0.1));
            (target + direction * (3.4 + within(0.25)), target)
        };
        let up = DVec3::new(within(0.02), 0.0, 1.0);
        Camera::from_fov(size, size, field_of_view(name), look_along(at, target - at, up))
    };
    (0..count).map(camera).collect()
}

/// Returns twenty-three cameras in a ring about an upright figure, the test views half-way between them and higher.
fn ring(size: u32) -> (Vec<Camera>, Vec<Camera>) {
    let around = |shift: f64, elevation: f64| {
        (0..23).map(|i| camera(size, TAU * (f64::from(i) + shift) / 23.0, elevation)).collect()
    };
    (around(0.0, 0.12), around(0.5, 0.25))
}
