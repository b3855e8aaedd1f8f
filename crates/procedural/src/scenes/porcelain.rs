//! A tea set of white porcelain with the palest blue and a little gold: near-white matter before white.

use super::*;

const TOP: f64 = -0.80;
const WHITE: u32 = 0xe8e8e6;
const GILT: u32 = 0xe2c482;

pub(super) fn porcelain(scene: &mut Builder) {
    plate(scene);
    pot(scene);
    vase(scene);
    cup(scene, polar(0.66, -80.0, TOP), 20.0);
    cup(scene, polar(0.70, 165.0, TOP), 130.0);
    hare(scene);
}

fn sprigged() -> Material {
    glossy(Flowers(rgb(0xeaeaea), rgb(0x96b2da), 7.5, true))
}

/// Adds a scalloped board.
fn plate(scene: &mut Builder) {
    scene.cylinder(v(0.0, 0.0, TOP - 0.10), 0.98, 0.10, satin(Marble(rgb(0xc8c9cc), rgb(0xa8aeb8), 2.2)));
    scene.each(around(24), |angle| Convex::cylinder(polar(0.98, angle, TOP - 0.10), 0.10, 0.085), glossy(WHITE));
}

fn pot(scene: &mut Builder) {
    let foot = v(0.12, 0.08, TOP);
    let at = |x: f64, z: f64| foot + v(0.8 * x, -0.6 * x, z);
    let belly =
        [0.20, 0.0, 0.22, 0.03, 0.19, 0.06, 0.32, 0.14, 0.41, 0.30, 0.38, 0.46, 0.26, 0.58, 0.19, 0.64, 0.20, 0.67];
    scene.lathe(foot, &belly, sprigged());
    scene.ring(at(0.0, 0.665), 0.198, 0.014, metal(GILT));
    let outline = [0.19, 0.67, 0.16, 0.73, 0.08, 0.78, 0.03, 0.80, 0.05, 0.84, 0.045, 0.88, 0.005, 0.905];
    scene.lathe(foot, &outline, glossy(WHITE));
    let spout = |s: f64| at(0.34 + 0.34 * s, 0.22 + 0.42 * s * s + 0.04 * s);
    for k in 0..14 {
        let (a, b) = (f64::from(k) / 14.0, f64::from(k + 1) / 14.0);
        let radius = |s: f64| 0.092 - 0.052 * s;
        scene.solid(Convex::taper(spout(a), spout(b), radius(a), radius(b)), glossy(WHITE));
        scene.sphere(spout(b), radius(b), glossy(WHITE));
    }
    let handle = |s: f64| {
        let (sin, cos) = (std::f64::consts::PI * (s - 0.5)).sin_cos();
        at(-0.34 - 0.26 * cos, 0.34 - 0.19 * sin)
    };
    scene.tube(handle, 24, 0.032, glossy(WHITE));
}

/// Adds a tall vase with rings about its neck and twigs with buds.
fn vase(scene: &mut Builder) {
    let foot = v(-0.36, 0.46, TOP);
    let outline =
        [0.15, 0.0, 0.16, 0.04, 0.13, 0.10, 0.22, 0.34, 0.26, 0.56, 0.20, 0.78, 0.09, 0.94, 0.08, 1.06, 0.13, 1.15];
    scene.lathe(foot, &outline, sprigged());
    scene.ring(foot + DVec3::Z * 1.15, 0.125, 0.012, metal(GILT));
    scene.rings([0.96, 1.03].map(|z| (foot + DVec3::Z * z, 0.086, 0.014)), glossy(WHITE));
    scene.cylinder(foot + DVec3::Z * 1.12, 0.115, 0.01, matt(0x969490));
    for (k, angle) in around(6).enumerate() {
        let angle = angle + 11.0;
        let start = foot + DVec3::Z * 1.10;
        let rise = 0.40 + 0.09 * (k * 5 % 4) as f64;
        let curve = |s: f64| start + polar(0.34 * s * s + 0.05 * s, angle, rise * s);
        scene.tube(curve, 8, 0.009, matt(0xcec8be));
        for s in [0.55, 0.72, 0.86, 1.0] {
            let bud = Plain(if s == 0.55 || s == 0.86 { rgb(0xfaf8f8) } else { rgb(0xf6e2e6) });
            scene.sphere(curve(s) + polar(0.03, angle + 400.0 * s, 0.012), 0.030, matt(bud));
        }
    }
}

/// Adds a cup of tea with milk on a saucer.
fn cup(scene: &mut Builder, at: DVec3, turn: f64) {
    scene.lathe(at, &[0.10, 0.0, 0.12, 0.012, 0.22, 0.035, 0.245, 0.055], glossy(WHITE));
    scene.ring(at + DVec3::Z * 0.055, 0.24, 0.010, metal(GILT));
    scene.lathe(at, &[0.08, 0.05, 0.07, 0.075, 0.13, 0.13, 0.155, 0.20, 0.165, 0.26], sprigged());
    scene.ring(at + DVec3::Z * 0.262, 0.160, 0.009, glossy(WHITE));
    scene.cylinder(at + DVec3::Z * 0.255, 0.152, 0.008, glossy(0xecdec8));
    let side = polar(1.0, turn, 0.0);
    let handle = LocalFrame::along(at + side * 0.17 + DVec3::Z * 0.16, side.cross(DVec3::Z));
    scene.ring(handle, 0.065, 0.014, glossy(WHITE));
}

/// Adds a crouching hare.
fn hare(scene: &mut Builder) {
    let ground = v(0.58, 0.52, TOP);
    let at = |x: f64, y: f64, z: f64| ground + v(0.7 * x - 0.7 * y, 0.7 * x + 0.7 * y, z);
    let body = LocalFrame::along(at(0.14, 0.0, 0.12), at(-0.20, 0.0, 0.24) - at(0.14, 0.0, 0.12));
    scene.lathe(body, &[0.01, -0.06, 0.09, -0.02, 0.145, 0.10, 0.13, 0.22, 0.08, 0.34, 0.01, 0.40], glossy(WHITE));
    let (head, nose, tail) = ((-0.22, 0.36, 0.105), (-0.30, 0.33, 0.065), (0.20, 0.12, 0.055));
    scene.each([head, nose, tail], |(x, z, radius)| Convex::sphere(at(x, 0.0, z), radius), glossy(WHITE));
    for side in [-1.0, 1.0] {
        let ear =
            LocalFrame::along(at(-0.20, side * 0.045, 0.42), v(0.12, 0.12, 1.0) + (at(0.0, side * 0.2, 0.0) - ground));
        scene.lathe(ear, &[0.01, 0.0, 0.038, 0.08, 0.036, 0.18, 0.004, 0.29], glossy(WHITE));
        scene.sphere(at(0.06, side * 0.10, 0.09), 0.09, glossy(WHITE));
        scene.sphere(at(-0.22, side * 0.07, 0.04), 0.045, glossy(WHITE));
        scene.sphere(at(-0.285, side * 0.075, 0.39), 0.014, glossy(0x787e8c));
    }
}
