//! A fish tank: panes of glass, water that dims what lies deep in it, bubbles, and a jellyfish.

use glam::DVec3;

use super::{bricks, matt, polar, rgb, stripes, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

const SAND: f64 = -0.52;
const BASE: f64 = -0.66;
const RIM: f64 = 0.62;
const HALF: DVec3 = DVec3::new(0.86, 0.50, 0.0);

pub(crate) fn aquarium() -> Builder {
    let mut scene = Builder::default();
    stand(&mut scene);
    tank(&mut scene);
    bottom(&mut scene);
    let bands = |a, b| stripes(a, b, v(0.0, 0.0, 9.0));
    fish(&mut scene, v(-0.36, -0.16, 0.12), 20.0, 1.0, bands(rgb(250, 130, 20), rgb(250, 244, 232)), rgb(240, 110, 20));
    fish(&mut scene, v(0.12, 0.20, 0.30), 200.0, 0.9, bands(rgb(250, 220, 40), rgb(30, 40, 90)), rgb(250, 220, 40));
    fish(&mut scene, v(0.48, -0.20, -0.10), 150.0, 1.15, Texture::Plain(rgb(30, 110, 220)), rgb(250, 200, 30));
    fish(&mut scene, v(-0.02, -0.22, -0.22), -15.0, 0.7, Texture::Plain(rgb(220, 40, 70)), rgb(250, 150, 150));
    jellyfish(&mut scene);
    scene
}

fn stand(scene: &mut Builder) {
    let wood = Texture::Planks { a: rgb(150, 98, 56), b: rgb(92, 54, 28), width: 0.13, length: 0.8 };
    scene.block(v(0.0, 0.0, BASE - 0.16), v(1.78, 1.06, 0.30), Material::satin(wood));
    scene.block(v(0.0, 0.0, BASE - 0.34), v(1.66, 0.94, 0.06), matt(rgb(50, 34, 24)));
    let knob = Material::metal(rgb(200, 200, 200));
    for x in [-0.44, 0.44] {
        for y in [-0.54, 0.54] {
            scene.sphere(v(x, y, BASE - 0.16), 0.035, knob);
        }
    }
    for x in [-1.0, 0.0, 1.0] {
        for y in [-0.531, 0.531] {
            let gap = matt(rgb(46, 30, 20));
            scene.block(v(0.888 * x, y, BASE - 0.16), v(0.02, 0.006, 0.28), gap);
        }
    }
}

fn tank(scene: &mut Builder) {
    let glass = Material::glass(rgb(150, 200, 190), 0.05);
    let (z, h) = (0.5 * (BASE + RIM), RIM - BASE);
    for side in [-1.0, 1.0] {
        scene.block(v(0.0, side * HALF.y, z), v(2.0 * HALF.x, 0.012, h), glass);
        scene.block(v(side * HALF.x, 0.0, z), v(0.012, 2.0 * HALF.y, h), glass);
    }
    let steel = Material::metal(rgb(70, 74, 80));
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let edge = v(x * HALF.x, y * HALF.y, 0.0);
        scene.rod(edge + DVec3::Z * BASE, edge + DVec3::Z * RIM, 0.020, steel);
        scene.sphere(edge + DVec3::Z * RIM, 0.026, steel);
    }
    for side in [-1.0, 1.0] {
        let (x, y) = (HALF.x, side * HALF.y);
        scene.rod(v(-x, y, RIM), v(x, y, RIM), 0.022, steel);
        let (x, y) = (side * HALF.x, HALF.y);
        scene.rod(v(x, -y, RIM), v(x, y, RIM), 0.022, steel);
    }
    // Water, and its surface, a little below the rim.
    let (low, high) = (BASE, RIM - 0.13);
    let water =
        Convex::block(v(0.0, 0.0, 0.5 * (low + high)), v(2.0 * HALF.x - 0.014, 2.0 * HALF.y - 0.014, high - low));
    scene.fill(water, v(0.10, 0.52, 0.62), 0.42);
    let surface = Convex::block(v(0.0, 0.0, high), v(2.0 * HALF.x - 0.02, 2.0 * HALF.y - 0.02, 0.004));
    scene.solid(surface, Material::glass(rgb(120, 210, 220), 0.10));
}

/// Adds sand, rocks, an arch, weeds and corals.
fn bottom(scene: &mut Builder) {
    let sand = Texture::Patches { a: rgb(236, 206, 150), b: rgb(200, 164, 108), per_unit: 14.0, cap: 9.0 };
    let size = v(2.0 * HALF.x - 0.03, 2.0 * HALF.y - 0.03, SAND - BASE);
    scene.block(v(0.0, 0.0, 0.5 * (BASE + SAND)), size, Material::matt(sand));
    let brick = bricks(rgb(168, 150, 138), rgb(84, 78, 76), [0.09, 0.05], false);
    let arch = v(0.28, 0.12, SAND + 0.18);
    let hole = vec![
        Convex::block(arch - DVec3::Z * 0.10, v(0.20, 1.0, 0.22)),
        Convex::rod(arch - DVec3::Y, arch + DVec3::Y, 0.10),
    ];
    scene.carved(Convex::block(arch, v(0.40, 0.18, 0.40)), hole, Material::matt(brick));
    for x in [-0.13, 0.0, 0.13] {
        scene.block(arch + v(x, 0.0, 0.23), v(0.08, 0.18, 0.07), Material::matt(brick));
    }
    let rock = Texture::Marble { a: rgb(120, 116, 124), b: rgb(60, 62, 72), per_unit: 6.0 };
    for (x, y, r) in
        [(-0.58, 0.22, 0.17), (-0.40, 0.30, 0.11), (-0.66, 0.0, 0.10), (0.68, 0.28, 0.12), (0.1, -0.36, 0.07)]
    {
        scene.sphere(v(x, y, SAND + 0.3 * r), r, Material::matt(rock));
    }
    let weed = stripes(rgb(60, 160, 50), rgb(30, 104, 44), v(12.0, 0.0, 0.0));
    for k in 0..9u32 {
        let s = f64::from(k);
        let foot = v(0.60 - 0.05 * (s % 3.0), -0.30 + 0.06 * s - 0.10 * (s % 2.0), SAND - 0.02);
        let tall = 0.48 + 0.12 * f64::from(k * 7 % 5);
        let curve = |t: f64| foot + v(0.05 * (6.0 * t + s).sin() * t, 0.05 * (5.0 * t + 2.0 * s).cos() * t, tall * t);
        scene.closed_tube(curve, 12, 0.017, Material::matt(weed));
    }
    for k in 0..7 {
        let angle = f64::from(k) * 51.0;
        let foot = v(-0.34, -0.30, SAND - 0.02);
        let tip = foot + polar(0.14, angle, 0.20 + 0.03 * f64::from(k % 3));
        let pink = matt(rgb(236, 90, 130));
        scene.solid(Convex::taper(foot, tip, 0.034, 0.020), pink);
        scene.sphere(tip, 0.032, matt(rgb(252, 180, 190)));
    }
    let bubble = Material::glass(rgb(230, 250, 255), 0.22);
    for k in 0..11 {
        let s = f64::from(k);
        let at = v(-0.60 + 0.03 * (2.1 * s).sin(), -0.18 + 0.03 * (1.7 * s).cos(), SAND + 0.10 + 0.085 * s);
        scene.sphere(at, 0.020 + 0.012 * (s * 0.37).fract(), bubble);
    }
}

fn fish(scene: &mut Builder, at: DVec3, turn: f64, size: f64, skin: Texture, fin: DVec3) {
    let (ahead, side) = (polar(1.0, turn, 0.0), polar(1.0, turn + 90.0, 0.0));
    let place = |a: f64, s: f64, z: f64| at + size * (ahead * a + side * s + DVec3::Z * z);
    let skin = Material::glossy(skin);
    let fin = matt(fin);
    let body = LocalFrame::along(at, ahead);
    let outline =
        [(0.008, -0.17), (0.03, -0.14), (0.075, -0.06), (0.092, 0.04), (0.07, 0.12), (0.03, 0.165), (0.004, 0.18)];
    let outline = outline.map(|(r, z)| (r * size, z * size));
    scene.lathe(body, &outline, skin);
    let blade =
        |c: DVec3, l: f64, h: f64, lean: f64| Convex::block(c, size * v(l, 0.014, h)).turned(turn).swung(c, side, lean);
    scene.solid(blade(place(-0.21, 0.0, 0.045), 0.12, 0.055, 35.0), fin);
    scene.solid(blade(place(-0.21, 0.0, -0.045), 0.12, 0.055, -35.0), fin);
    scene.solid(blade(place(-0.01, 0.0, 0.10), 0.15, 0.05, 12.0), fin);
    scene.solid(blade(place(-0.02, 0.0, -0.09), 0.09, 0.04, -15.0), fin);
    for s in [-1.0, 1.0] {
        scene.sphere(place(0.115, s * 0.055, 0.025), 0.023 * size, matt(rgb(250, 250, 250)));
        scene.sphere(place(0.122, s * 0.069, 0.026), 0.013 * size, matt(rgb(8, 8, 10)));
    }
}

/// Adds a bell that can be looked through, with threads.
fn jellyfish(scene: &mut Builder) {
    let foot = LocalFrame::at(v(-0.10, 0.02, 0.16));
    let bell = Material { reflectance: 0.02, ..Material::glass(rgb(230, 130, 220), 0.34) };
    let foot = LocalFrame { origin: foot.origin + v(-0.52, 0.20, 0.0), ..foot };
    scene.lathe(foot, &[(0.13, 0.0), (0.14, 0.04), (0.11, 0.11), (0.06, 0.15), (0.004, 0.165)], bell);
    for k in 0..8 {
        let angle = f64::from(k) * 45.0;
        let curve = |s: f64| {
            let wave = 0.02 * (9.0 * s + f64::from(k)).sin();
            foot.origin + polar(0.10 - 0.03 * s + wave, angle, -0.32 * s)
        };
        scene.closed_tube(curve, 10, 0.009, Material { reflectance: 0.02, ..Material::glass(rgb(240, 180, 230), 0.5) });
    }
}
