//! Scenes drawn from a seed: a few plain solids on a plate, for training on many scenes.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

use super::*;

/// Height of the plate's upper side.
const GROUND: f64 = -0.62;
/// Max distance of objects from the vertical axis.
const REACH: f64 = 0.98;

pub(crate) fn random(scene: &mut Builder, seed: u64) {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let plate = material(rng);
    if rng.random() {
        scene.cylinder(v(0.0, 0.0, GROUND - 0.12), REACH, 0.12, plate);
    } else {
        let side = REACH * 1.35;
        scene.solid(Convex::block(v(0.0, 0.0, GROUND - 0.06), v(side, side, 0.12)).turned(turn(rng)), plate);
    }
    let count = rng.random_range(3..=6);
    let first = turn(rng);
    for i in 0..count {
        let size: f64 = rng.random_range(0.16..0.36);
        let radius = rng.random_range(0.25..REACH - size);
        let angle = first + 360.0 * f64::from(i) / f64::from(count) + rng.random_range(-20.0..20.0);
        thing(scene, rng, polar(radius, angle, GROUND), size);
    }
    if rng.random() {
        let size = rng.random_range(0.2..0.34);
        thing(scene, rng, v(0.0, 0.0, GROUND), size);
    }
}

fn turn(rng: &mut impl Rng) -> f64 {
    rng.random_range(0.0..360.0)
}

/// Adds one solid, or two on top of one another, that stands on `foot` within `size` of the vertical through it.
fn thing(scene: &mut Builder, rng: &mut impl Rng, foot: DVec3, size: f64) {
    let tall = size * rng.random_range(1.0..2.6);
    let material = material(rng);
    match rng.random_range(0..6) {
        0 => scene.sphere(foot + DVec3::Z * size, size, material),
        1 => {
            let half = v(0.5 * size, 0.5 * size, 0.5 * tall);
            scene.solid(Convex::block(foot + DVec3::Z * half.z, 2.0 * half).turned(turn(rng)), material)
        }
        2 => scene.cylinder(foot, 0.7 * size, tall, material),
        3 => scene.cone(foot, size, 0.1 * size, tall, material),
        4 => {
            let across = polar(1.0, turn(rng), 0.0);
            let tube = 0.25 * size;
            scene.ring(LocalFrame::along(foot + DVec3::Z * size, across), size - tube, tube, material)
        }
        _ => {
            let on_top = self::material(rng);
            scene.cylinder(foot, 0.5 * size, tall, material);
            scene.sphere(foot + DVec3::Z * (tall + 0.7 * size), 0.7 * size, on_top)
        }
    };
}

fn material(rng: &mut impl Rng) -> Material {
    let (a, b) = (colour(rng), colour(rng));
    let texture = match rng.random_range(0..5) {
        0 | 1 => Plain(a),
        2 => Checker(a, b, DVec3::splat(rng.random_range(2.0..6.0))),
        3 => {
            let along = [DVec3::X, DVec3::Y, DVec3::Z][rng.random_range(0..3)];
            Stripes(a, b, along * rng.random_range(2.0..6.0))
        }
        _ => Bands(a, b, colour(rng), rng.random_range(1.5..4.0)),
    };
    if rng.random() { matt(texture) } else { satin(texture) }
}

/// Returns a colour of any hue, linear.
fn colour(rng: &mut impl Rng) -> DVec3 {
    let hue = TAU * rng.random::<f64>();
    let light = rng.random_range(0.25..0.75);
    let vivid = rng.random_range(0.3..1.0);
    let channel = |k: f64| (light * (1.0 + vivid * (hue + k * TAU / 3.0).cos()) * 0.8).clamp(0.02, 1.0);
    v(channel(0.0), channel(1.0), channel(2.0))
}
