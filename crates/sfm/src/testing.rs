//! A world whose cameras and points are known.

use glam::{DMat3, DVec2, DVec3};
pub(crate) use infonerf_scene::rotation_angle_deg as turn;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bundle::{Bundle, Point};
use crate::camera::{Pose, SimpleRadial};

/// Returns points in a box of side 2, seen without error by `cameras` at a distance of 4, in images of 1000 × 800 pixels.
pub(crate) fn world(seed: u64, cameras: usize, points: usize) -> Bundle {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut any = || DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
    let lens = SimpleRadial { focal: 900.0, k1: -0.05, centre: DVec2::new(500.0, 400.0) };
    let pose = |i: usize| {
        let away = DMat3::from_rotation_y(0.15 * i as f64) * DVec3::new(0.0, 0.3 * (i as f64).sin(), -4.0);
        let z = (0.2 * any() - away).normalize();
        let x = DVec3::Y.cross(z).normalize();
        let rotation = DMat3::from_cols(x, z.cross(x), z).transpose();
        Pose { rotation, translation: -(rotation * away) }
    };
    let poses: Vec<Pose> = (0..cameras).map(pose).collect();
    let see = |position: DVec3| {
        let pixel = |pose: &Pose| lens.project(pose.transform(position)).unwrap();
        Point { position, seen: poses.iter().map(pixel).enumerate().collect() }
    };
    let points = (0..points).map(|_| see(any())).collect();
    Bundle { lens, poses, points }
}

/// Moves observations by up to `noise` pixels on each axis, and every `wrong`th one to a random pixel.
pub(crate) fn disturb(points: &mut [Point], noise: f64, wrong: usize) {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for (i, (_, pixel)) in points.iter_mut().flat_map(|p| &mut p.seen).enumerate() {
        if (i + 1) % wrong == 0 {
            *pixel = DVec2::new(random.random_range(0.0..1000.0), random.random_range(0.0..800.0));
        } else {
            *pixel += DVec2::new(random.random_range(-noise..=noise), random.random_range(-noise..=noise));
        }
    }
}
