//! A fish tank: panes of glass, water that dims what lies deep in it, bubbles, and a jellyfish.

use super::*;

const SAND: f64 = -0.52;
const BASE: f64 = -0.66;
const RIM: f64 = 0.62;
const HALF: DVec3 = DVec3::new(0.86, 0.50, 0.0);

pub(super) fn aquarium(scene: &mut Builder) {
    stand(scene);
    tank(scene);
    bottom(scene);
    let bands = |a, b| Stripes(a, b, v(0.0, 0.0, 9.0));
    fish(scene, v(-0.36, -0.16, 0.12), 20.0, 1.0, bands(rgb(0xfa8214), rgb(0xfaf4e8)), rgb(0xf06e14));
    fish(scene, v(0.12, 0.20, 0.30), 200.0, 0.9, bands(rgb(0xfadc28), rgb(0x1e285a)), rgb(0xfadc28));
    fish(scene, v(0.48, -0.20, -0.10), 150.0, 1.15, Plain(rgb(0x1e6edc)), rgb(0xfac81e));
    fish(scene, v(-0.02, -0.22, -0.22), -15.0, 0.7, Plain(rgb(0xdc2846)), rgb(0xfa9696));
    jellyfish(scene);
}

fn stand(scene: &mut Builder) {
    scene.block(v(0.0, 0.0, BASE - 0.16), v(1.78, 1.06, 0.30), satin(Planks(rgb(0x966238), rgb(0x5c361c), 0.13, 0.8)));
    scene.block(v(0.0, 0.0, BASE - 0.34), v(1.66, 0.94, 0.06), matt(0x322218));
    let knobs = [(-0.44, -0.54), (-0.44, 0.54), (0.44, -0.54), (0.44, 0.54)];
    scene.each(knobs, |(x, y)| Convex::sphere(v(x, y, BASE - 0.16), 0.035), metal(0xc8c8c8));
    for x in [-1.0, 0.0, 1.0] {
        let seam = |y: f64| Convex::block(v(0.888 * x, y, BASE - 0.16), v(0.02, 0.006, 0.28));
        scene.each([-0.531, 0.531], seam, matt(0x2e1e14));
    }
}

fn tank(scene: &mut Builder) {
    let pane = glass(0x96c8be, 0.05);
    let (z, h) = (0.5 * (BASE + RIM), RIM - BASE);
    for side in [-1.0, 1.0] {
        scene.block(v(0.0, side * HALF.y, z), v(2.0 * HALF.x, 0.012, h), pane);
        scene.block(v(side * HALF.x, 0.0, z), v(0.012, 2.0 * HALF.y, h), pane);
    }
    let steel = metal(0x464a50);
    for (x, y) in CORNERS {
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
    let size = v(2.0 * HALF.x - 0.014, 2.0 * HALF.y - 0.014, high - low);
    scene.fill(Convex::block(v(0.0, 0.0, 0.5 * (low + high)), size), v(0.10, 0.52, 0.62), 0.42);
    scene.block(v(0.0, 0.0, high), v(2.0 * HALF.x - 0.02, 2.0 * HALF.y - 0.02, 0.004), glass(0x78d2dc, 0.10));
}

/// Adds sand, rocks, an arch, weeds and corals.
fn bottom(scene: &mut Builder) {
    let size = v(2.0 * HALF.x - 0.03, 2.0 * HALF.y - 0.03, SAND - BASE);
    scene.block(v(0.0, 0.0, 0.5 * (BASE + SAND)), size, matt(Patches(rgb(0xecce96), rgb(0xc8a46c), 14.0)));
    let brick = Bricks(rgb(0xa8968a), rgb(0x544e4c), 0.09, 0.05, false);
    let arch = v(0.28, 0.12, SAND + 0.18);
    let opening = Convex::block(arch - DVec3::Z * 0.10, v(0.20, 1.0, 0.22));
    let hole = vec![opening, Convex::rod(arch - DVec3::Y, arch + DVec3::Y, 0.10)];
    scene.carved(Convex::block(arch, v(0.40, 0.18, 0.40)), hole, matt(brick));
    scene.each([-0.13, 0.0, 0.13], |x| Convex::block(arch + v(x, 0.0, 0.23), v(0.08, 0.18, 0.07)), matt(brick));
    let rock = Marble(rgb(0x78747c), rgb(0x3c3e48), 6.0);
    let rocks = [(-0.58, 0.22, 0.17), (-0.40, 0.30, 0.11), (-0.66, 0.0, 0.10), (0.68, 0.28, 0.12), (0.1, -0.36, 0.07)];
    scene.each(rocks, |(x, y, r)| Convex::sphere(v(x, y, SAND + 0.3 * r), r), matt(rock));
    let weed = Stripes(rgb(0x3ca032), rgb(0x1e682c), v(12.0, 0.0, 0.0));
    for k in 0..9u32 {
        let s = f64::from(k);
        let foot = v(0.60 - 0.05 * (s % 3.0), -0.30 + 0.06 * s - 0.10 * (s % 2.0), SAND - 0.02);
        let tall = 0.48 + 0.12 * f64::from(k * 7 % 5);
        let curve = |t: f64| foot + v(0.05 * (6.0 * t + s).sin() * t, 0.05 * (5.0 * t + 2.0 * s).cos() * t, tall * t);
        scene.tube(curve, 12, 0.017, matt(weed));
    }
    for k in 0..7 {
        let foot = v(-0.34, -0.30, SAND - 0.02);
        let tip = foot + polar(0.14, f64::from(k) * 51.0, 0.20 + 0.03 * f64::from(k % 3));
        scene.solid(Convex::taper(foot, tip, 0.034, 0.020), matt(0xec5a82));
        scene.sphere(tip, 0.032, matt(0xfcb4be));
    }
    for k in 0..11 {
        let s = f64::from(k);
        let at = v(-0.60 + 0.03 * (2.1 * s).sin(), -0.18 + 0.03 * (1.7 * s).cos(), SAND + 0.10 + 0.085 * s);
        scene.sphere(at, 0.020 + 0.012 * (s * 0.37).fract(), glass(0xe6faff, 0.22));
    }
}

fn fish(scene: &mut Builder, at: DVec3, turn: f64, size: f64, skin: Texture, fin: DVec3) {
    let (ahead, side) = (polar(1.0, turn, 0.0), polar(1.0, turn + 90.0, 0.0));
    let place = |a: f64, s: f64, z: f64| at + size * (ahead * a + side * s + DVec3::Z * z);
    let fin = matt(fin);
    let outline = [0.008, -0.17, 0.03, -0.14, 0.075, -0.06, 0.092, 0.04, 0.07, 0.12, 0.03, 0.165, 0.004, 0.18];
    scene.lathe(LocalFrame::along(at, ahead), &outline.map(|length| length * size), glossy(skin));
    let blade =
        |c: DVec3, l: f64, h: f64, lean: f64| Convex::block(c, size * v(l, 0.014, h)).turned(turn).swung(c, side, lean);
    scene.solid(blade(place(-0.21, 0.0, 0.045), 0.12, 0.055, 35.0), fin);
    scene.solid(blade(place(-0.21, 0.0, -0.045), 0.12, 0.055, -35.0), fin);
    scene.solid(blade(place(-0.01, 0.0, 0.10), 0.15, 0.05, 12.0), fin);
    scene.solid(blade(place(-0.02, 0.0, -0.09), 0.09, 0.04, -15.0), fin);
    for s in [-1.0, 1.0] {
        scene.sphere(place(0.115, s * 0.055, 0.025), 0.023 * size, matt(0xfafafa));
        scene.sphere(place(0.122, s * 0.069, 0.026), 0.013 * size, matt(0x08080a));
    }
}

/// Adds a bell that can be looked through, with threads.
fn jellyfish(scene: &mut Builder) {
    let foot = v(-0.10, 0.02, 0.16) + v(-0.52, 0.20, 0.0);
    let bell = Material { reflectance: 0.02, ..glass(0xe682dc, 0.34) };
    scene.lathe(foot, &[0.13, 0.0, 0.14, 0.04, 0.11, 0.11, 0.06, 0.15, 0.004, 0.165], bell);
    for (k, angle) in around(8).enumerate() {
        let wave = |s: f64| 0.02 * (9.0 * s + k as f64).sin();
        let curve = |s: f64| foot + polar(0.10 - 0.03 * s + wave(s), angle, -0.32 * s);
        scene.tube(curve, 10, 0.009, Material { reflectance: 0.02, ..glass(0xf0b4e6, 0.5) });
    }
}
