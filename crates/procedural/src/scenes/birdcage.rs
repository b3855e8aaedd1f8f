//! A domed birdcage of thin wires with a mesh floor, and a parrot on a swing: rods less than a pixel wide.

use std::f64::consts::PI;

use glam::DVec3;

use super::{flowers, glossy, matt, polar, rgb, stripes, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

const FLOOR: f64 = -0.86;
const SPRING: f64 = 0.22;
const RADIUS: f64 = 0.74;
const WIRES: usize = 26;

pub(crate) fn birdcage() -> Builder {
    let mut scene = Builder::default();
    tray(&mut scene);
    wires(&mut scene);
    furniture(&mut scene);
    parrot(&mut scene);
    scene
}

fn brass() -> Material {
    Material::metal(rgb(206, 160, 74))
}

fn tray(scene: &mut Builder) {
    let enamel = flowers(rgb(34, 84, 92), rgb(236, 214, 150), 6.0, true);
    let hollow = vec![Convex::cylinder(v(0.0, 0.0, FLOOR - 0.12), RADIUS - 0.03, 0.4)];
    scene.carved(Convex::cylinder(v(0.0, 0.0, FLOOR - 0.16), RADIUS + 0.03, 0.17), hollow, Material::glossy(enamel));
    for z in [FLOOR - 0.16, FLOOR + 0.01] {
        scene.ring(LocalFrame::at(v(0.0, 0.0, z)), RADIUS + 0.03, 0.022, brass());
    }
    for k in 0..4 {
        let foot = polar(RADIUS - 0.06, f64::from(k) * 90.0 + 45.0, FLOOR - 0.21);
        scene.sphere(foot, 0.05, brass());
    }
    // The mesh over the tray.
    let steel = Material::metal(rgb(176, 182, 190));
    for i in -9..=9 {
        let x = f64::from(i) * 0.075;
        let y = (RADIUS * RADIUS - x * x).sqrt();
        scene.rod(v(x, -y, FLOOR), v(x, y, FLOOR), 0.007, steel);
        scene.rod(v(-y, x, FLOOR + 0.01), v(y, x, FLOOR + 0.01), 0.007, steel);
    }
}

fn wires(scene: &mut Builder) {
    // An onion dome: (radius, height) for s from 0 at its foot to 1 at its tip.
    let dome = |s: f64| {
        let a = 0.5 * PI * s;
        (RADIUS * a.cos() * (1.0 + 0.10 * (2.0 * PI * s).sin()), SPRING + 0.78 * a.sin() + 0.08 * s.powi(6))
    };
    for k in 0..WIRES {
        let angle = 360.0 * k as f64 / WIRES as f64;
        scene.rod(polar(RADIUS, angle, FLOOR), polar(RADIUS, angle, SPRING), 0.010, brass());
        let arc = |s: f64| {
            let (radius, z) = dome(s);
            polar(radius, angle, z)
        };
        scene.closed_tube(arc, 12, 0.010, brass());
    }
    for (z, tube) in [(-0.58, 0.012), (-0.32, 0.012), (-0.05, 0.012), (SPRING, 0.020)] {
        scene.ring(LocalFrame::at(v(0.0, 0.0, z)), RADIUS, tube, brass());
    }
    for s in [0.35, 0.65] {
        let (radius, z) = dome(s);
        scene.ring(LocalFrame::at(v(0.0, 0.0, z)), radius, 0.013, brass());
    }
    scene.sphere(v(0.0, 0.0, 1.09), 0.055, brass());
    scene.ring(LocalFrame::along(v(0.0, 0.0, 1.20), v(0.4, 1.0, 0.0)), 0.075, 0.014, brass());
}

/// Adds perches, two bowls, and a swing.
fn furniture(scene: &mut Builder) {
    let wood = stripes(rgb(172, 118, 66), rgb(124, 78, 40), v(0.0, 0.0, 9.0));
    scene.rod(polar(RADIUS, 20.0, -0.45), polar(RADIUS, 145.0, -0.45), 0.026, Material::matt(wood));
    scene.rod(polar(RADIUS, 200.0, -0.15), polar(RADIUS, 300.0, -0.15), 0.024, Material::matt(wood));
    for (angle, colour) in [(75.0, rgb(196, 48, 40)), (250.0, rgb(40, 110, 190))] {
        let at = polar(0.56, angle, FLOOR + 0.02);
        let cup = vec![Convex::cylinder(at + DVec3::Z * 0.05, 0.085, 0.3)];
        scene.carved(Convex::cone(at, 0.08, 0.105, 0.13), cup, glossy(colour));
        let seed = Texture::Checker { a: rgb(216, 180, 96), b: rgb(150, 104, 48), per_unit: v(40.0, 40.0, 1.0) };
        scene.cylinder(at + DVec3::Z * 0.05, 0.085, 0.04, Material::matt(seed));
    }
    for x in [-0.17, 0.17] {
        scene.rod(v(x, 0.0, -0.28), v(0.3 * x, 0.0, 0.98), 0.008, brass());
    }
    scene.rod(v(-0.20, 0.0, -0.28), v(0.20, 0.0, -0.28), 0.022, Material::matt(wood));
}

/// Adds a parrot that faces −y.
fn parrot(scene: &mut Builder) {
    let down = Texture::Shingles { a: rgb(226, 60, 36), b: rgb(246, 150, 40), around: 11.0, per_unit: 26.0 };
    let body = LocalFrame::along(v(0.0, 0.10, -0.30), v(0.0, -0.28, 1.0));
    let outline = [
        (0.01, -0.02),
        (0.09, 0.03),
        (0.135, 0.14),
        (0.13, 0.24),
        (0.095, 0.33),
        (0.10, 0.40),
        (0.06, 0.49),
        (0.005, 0.52),
    ];
    scene.lathe(body, &outline, Material::matt(down));
    let wing = Texture::Shingles { a: rgb(24, 92, 190), b: rgb(40, 170, 130), around: 16.0, per_unit: 22.0 };
    for side in [-1.0, 1.0] {
        let frame = LocalFrame::along(v(side * 0.115, 0.20, -0.36), v(side * 0.05, -0.30, 1.0));
        let feather = [(0.004, -0.16), (0.03, -0.05), (0.055, 0.12), (0.06, 0.26), (0.03, 0.35), (0.004, 0.38)];
        scene.lathe(frame, &feather, Material::matt(wing));
        scene.sphere(v(side * 0.062, -0.085, 0.14), 0.024, matt(rgb(250, 250, 240)));
        scene.sphere(v(side * 0.078, -0.093, 0.14), 0.013, glossy(rgb(10, 10, 12)));
    }
    let tail = stripes(rgb(30, 90, 190), rgb(226, 66, 36), v(0.0, 0.0, 6.0));
    scene.solid(Convex::taper(v(0.0, 0.10, -0.28), v(0.0, 0.26, -0.72), 0.07, 0.02), Material::matt(tail));
    let beak = glossy(rgb(40, 36, 36));
    scene.solid(Convex::taper(v(0.0, -0.11, 0.12), v(0.0, -0.20, 0.05), 0.045, 0.004), beak);
}
