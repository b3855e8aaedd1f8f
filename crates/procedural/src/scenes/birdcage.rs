//! A domed birdcage of thin wires with a mesh floor, and a parrot on a swing: rods less than a pixel wide.

use std::f64::consts::PI;

use super::*;

const FLOOR: f64 = -0.86;
const SPRING: f64 = 0.22;
const RADIUS: f64 = 0.74;
const WIRES: u32 = 26;
const BRASS: u32 = 0xcea04a;

pub(super) fn birdcage(scene: &mut Builder) {
    tray(scene);
    wires(scene);
    furniture(scene);
    parrot(scene);
}

fn tray(scene: &mut Builder) {
    let enamel = Flowers(rgb(0x22545c), rgb(0xecd696), 6.0, true);
    let hollow = vec![Convex::cylinder(v(0.0, 0.0, FLOOR - 0.12), RADIUS - 0.03, 0.4)];
    scene.carved(Convex::cylinder(v(0.0, 0.0, FLOOR - 0.16), RADIUS + 0.03, 0.17), hollow, glossy(enamel));
    scene.rings([FLOOR - 0.16, FLOOR + 0.01].map(|z| (v(0.0, 0.0, z), RADIUS + 0.03, 0.022)), metal(BRASS));
    let foot = |degrees: f64| Convex::sphere(polar(RADIUS - 0.06, 45.0 + degrees, FLOOR - 0.21), 0.05);
    scene.each(around(4), foot, metal(BRASS));
    // The mesh over the tray.
    let steel = metal(0xb0b6be);
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
    for angle in around(WIRES) {
        scene.rod(polar(RADIUS, angle, FLOOR), polar(RADIUS, angle, SPRING), 0.010, metal(BRASS));
        let arc = |s: f64| {
            let (radius, z) = dome(s);
            polar(radius, angle, z)
        };
        scene.tube(arc, 12, 0.010, metal(BRASS));
    }
    let hoops = [(-0.58, 0.012), (-0.32, 0.012), (-0.05, 0.012), (SPRING, 0.020)];
    scene.rings(hoops.map(|(z, tube)| (v(0.0, 0.0, z), RADIUS, tube)), metal(BRASS));
    scene.rings([0.35, 0.65].map(dome).map(|(radius, z)| (v(0.0, 0.0, z), radius, 0.013)), metal(BRASS));
    scene.sphere(v(0.0, 0.0, 1.09), 0.055, metal(BRASS));
    scene.ring(LocalFrame::along(v(0.0, 0.0, 1.20), v(0.4, 1.0, 0.0)), 0.075, 0.014, metal(BRASS));
}

/// Adds perches, two bowls, and a swing.
fn furniture(scene: &mut Builder) {
    let wood = Stripes(rgb(0xac7642), rgb(0x7c4e28), v(0.0, 0.0, 9.0));
    scene.rod(polar(RADIUS, 20.0, -0.45), polar(RADIUS, 145.0, -0.45), 0.026, matt(wood));
    scene.rod(polar(RADIUS, 200.0, -0.15), polar(RADIUS, 300.0, -0.15), 0.024, matt(wood));
    for (angle, colour) in [(75.0, rgb(0xc43028)), (250.0, rgb(0x286ebe))] {
        let at = polar(0.56, angle, FLOOR + 0.02);
        let cup = vec![Convex::cylinder(at + DVec3::Z * 0.05, 0.085, 0.3)];
        scene.carved(Convex::cone(at, 0.08, 0.105, 0.13), cup, glossy(colour));
        let seed = Checker(rgb(0xd8b460), rgb(0x966830), v(40.0, 40.0, 1.0));
        scene.cylinder(at + DVec3::Z * 0.05, 0.085, 0.04, matt(seed));
    }
    scene.each([-0.17, 0.17], |x| Convex::rod(v(x, 0.0, -0.28), v(0.3 * x, 0.0, 0.98), 0.008), metal(BRASS));
    scene.rod(v(-0.20, 0.0, -0.28), v(0.20, 0.0, -0.28), 0.022, matt(wood));
}

/// Adds a parrot that faces −y.
fn parrot(scene: &mut Builder) {
    let down = Shingles(rgb(0xe23c24), rgb(0xf69628), 11.0, 26.0);
    let body = LocalFrame::along(v(0.0, 0.10, -0.30), v(0.0, -0.28, 1.0));
    let outline = [0.01, -0.02, 0.09, 0.03, 0.135, 0.14, 0.13, 0.24, 0.095, 0.33, 0.10, 0.40, 0.06, 0.49, 0.005, 0.52];
    scene.lathe(body, &outline, matt(down));
    let wing = Shingles(rgb(0x185cbe), rgb(0x28aa82), 16.0, 22.0);
    for side in [-1.0, 1.0] {
        let frame = LocalFrame::along(v(side * 0.115, 0.20, -0.36), v(side * 0.05, -0.30, 1.0));
        let feather = [0.004, -0.16, 0.03, -0.05, 0.055, 0.12, 0.06, 0.26, 0.03, 0.35, 0.004, 0.38];
        scene.lathe(frame, &feather, matt(wing));
        scene.sphere(v(side * 0.062, -0.085, 0.14), 0.024, matt(0xfafaf0));
        scene.sphere(v(side * 0.078, -0.093, 0.14), 0.013, glossy(0x0a0a0c));
    }
    let tail = Stripes(rgb(0x1e5abe), rgb(0xe24224), v(0.0, 0.0, 6.0));
    scene.solid(Convex::taper(v(0.0, 0.10, -0.28), v(0.0, 0.26, -0.72), 0.07, 0.02), matt(tail));
    scene.solid(Convex::taper(v(0.0, -0.11, 0.12), v(0.0, -0.20, 0.05), 0.045, 0.004), glossy(0x282424));
}
