//! A sitting room seen from within: walls, floor and ceiling are everywhere behind the furniture.

use super::*;

const WALL: f64 = 4.4;
const SIDE: f64 = 2.0;
const HIGH: f64 = 2.75;

pub(super) fn room(scene: &mut Builder) {
    scene.backdrop(true);
    shell(scene);
    on_the_walls(scene);
    scene.backdrop(false);
    sofa(scene);
    low_table(scene);
    dresser(scene);
    corner(scene);
}

fn shell(scene: &mut Builder) {
    // Shading sends no light from the floor to the ceiling: the ceiling's bright colour replaces it.
    let (near, thick) = (-1.0, 0.08);
    let (y, deep) = (0.5 * (near + WALL), WALL - near);
    let boards = Planks(rgb(0xb07a4c), rgb(0x7a4c2a), 0.16, 1.3);
    scene.block(v(0.0, y, -0.5 * thick), v(2.0 * SIDE, deep, thick), glossy(boards));
    scene.block(v(0.0, y, HIGH + 0.5 * thick), v(2.0 * SIDE, deep, thick), matt(v(3.4, 3.25, 3.0)));
    let paper = Flowers(rgb(0x5c8886), rgb(0xceceaa), 4.0, false);
    let plain = Stripes(rgb(0xe2cea6), rgb(0xd6bc90), v(0.0, 4.0, 0.0));
    scene.block(v(0.0, WALL + 0.5 * thick, 0.5 * HIGH), v(2.0 * SIDE + 0.2, thick, HIGH + 0.2), matt(paper));
    scene.block(v(0.0, near - 0.5 * thick, 0.5 * HIGH), v(2.0 * SIDE + 0.2, thick, HIGH + 0.2), matt(paper));
    let white = satin(0xf0eade);
    for side in [-1.0, 1.0] {
        scene.block(v(side * (SIDE + 0.5 * thick), y, 0.5 * HIGH), v(thick, deep, HIGH + 0.2), matt(plain));
        scene.block(v(side * (SIDE - 0.01), y, 0.07), v(0.03, deep, 0.14), white);
        scene.block(v(side * (SIDE - 0.03), y, HIGH - 0.05), v(0.07, deep, 0.09), white);
    }
    scene.block(v(0.0, WALL - 0.01, 0.07), v(2.0 * SIDE, 0.03, 0.14), white);
    scene.block(v(0.0, WALL - 0.03, HIGH - 0.05), v(2.0 * SIDE, 0.07, 0.09), white);
    scene.block(v(0.0, 2.35, 0.006), v(2.3, 1.7, 0.012), matt(Flowers(rgb(0x96242c), rgb(0xecc478), 4.5, false)));
    let border = Stripes(rgb(0x1e2850), rgb(0xe2c482), v(9.0, 9.0, 0.0));
    scene.block(v(0.0, 2.35, 0.004), v(2.5, 1.9, 0.010), matt(border));
}

fn on_the_walls(scene: &mut Builder) {
    let gold = metal(0xc4964c);
    let frame = |scene: &mut Builder, at: DVec3, wide: f64, high: f64, picture: Texture| {
        scene.block(at - DVec3::Y * 0.02, v(wide, 0.05, high), gold);
        scene.block(at - DVec3::Y * 0.035, v(wide - 0.10, 0.03, high - 0.10), matt(0xf0eadc));
        scene.block(at - DVec3::Y * 0.04, v(wide - 0.24, 0.03, high - 0.24), satin(picture));
    };
    frame(scene, v(-0.1, WALL, 1.72), 1.05, 0.75, Bands(rgb(0x1e508c), rgb(0xf0aa5a), rgb(0xfae2aa), 3.0));
    frame(scene, v(-1.15, WALL, 1.78), 0.55, 0.70, Patches(rgb(0xc8783c), rgb(0x3c6e78), 7.0));
    // A window in the right wall, with curtains, and a mirror on the left one.
    scene.block(v(SIDE, 2.7, 1.55), v(0.02, 1.1, 1.3), matt(Patches(rgb(0xfcfcfa), rgb(0x82baec), 2.2)));
    let white = satin(0xf6f2e8);
    let rail = |(dz, y, z): (f64, f64, f64)| Convex::block(v(SIDE - 0.03, 2.7, 1.55 + dz), v(0.08, y, z));
    scene.each([(0.66, 1.24, 0.08), (-0.66, 1.3, 0.10), (0.1, 1.1, 0.05)], rail, white);
    scene.each([-0.57, 0.0, 0.57], |dy| Convex::block(v(SIDE - 0.03, 2.7 + dy, 1.55), v(0.07, 0.06, 1.36)), white);
    let cloth = matt(Stripes(rgb(0xbe503c), rgb(0x96322e), v(0.0, 0.0, 3.0)));
    let fold = |k: i32| if k < 5 { 1.92 + 0.06 * f64::from(k) } else { 3.20 + 0.06 * f64::from(k - 5) };
    scene.each(0..10, |k| Convex::cylinder(v(SIDE - 0.08, fold(k), 0.35), 0.045, 1.98), cloth);
    scene.rod(v(SIDE - 0.08, 1.75, 2.36), v(SIDE - 0.08, 3.65, 2.36), 0.022, gold);
    let at = v(-SIDE, 2.9, 1.6);
    scene.rod(at, at + DVec3::X * 0.03, 0.42, gold);
    scene.rod(at, at + DVec3::X * 0.04, 0.36, mirror(0xe2e8ec));
}

fn sofa(scene: &mut Builder) {
    let cloth = matt(Checker(rgb(0x2c5482), rgb(0x244670), v(9.0, 9.0, 9.0)));
    let (x, y) = (-0.15, 3.75);
    scene.block(v(x, y, 0.26), v(1.9, 0.80, 0.24), cloth);
    scene.block(v(x, y + 0.36, 0.55), v(1.9, 0.22, 0.62), cloth);
    scene.rod(v(x - 0.95, y + 0.36, 0.86), v(x + 0.95, y + 0.36, 0.86), 0.11, cloth);
    for side in [-1.0, 1.0] {
        let arm = x + side * 0.98;
        scene.block(v(arm, y, 0.36), v(0.20, 0.82, 0.44), cloth);
        scene.rod(v(arm, y - 0.41, 0.58), v(arm, y + 0.41, 0.58), 0.12, cloth);
        scene.block(v(x + side * 0.44, y - 0.06, 0.44), v(0.86, 0.70, 0.14), cloth);
        scene.each([-0.34, 0.34], |dy| Convex::cylinder(v(x + side * 0.9, y + dy, 0.0), 0.03, 0.15), matt(0x462816));
    }
    let cushion = Convex::block(v(x - 0.62, y + 0.12, 0.70), v(0.40, 0.14, 0.40));
    let cover = matt(Flowers(rgb(0xe6aa32), rgb(0xfaecc8), 9.0, false));
    scene.solid(cushion.swung(v(x - 0.62, y, 0.5), DVec3::X, -18.0), cover);
    let cushion = Convex::block(v(x + 0.58, y + 0.12, 0.68), v(0.38, 0.13, 0.38));
    let cover = matt(Stripes(rgb(0xce3c32), rgb(0xf6ecdc), v(9.0, 0.0, 0.0)));
    scene.solid(cushion.swung(v(x + 0.58, y, 0.5), DVec3::X, -20.0), cover);
}

fn low_table(scene: &mut Builder) {
    let wood = glossy(Planks(rgb(0x824e28), rgb(0x562e16), 0.13, 1.2));
    let c = v(0.05, 2.35, 0.0);
    scene.block(c + DVec3::Z * 0.42, v(1.0, 0.58, 0.045), wood);
    scene.block(c + DVec3::Z * 0.16, v(0.88, 0.48, 0.025), wood);
    let leg = |(x, y): (f64, f64)| Convex::taper(c + v(x, y, 0.0), c + v(x, y, 0.40), 0.022, 0.034);
    scene.each([(-0.45, -0.25), (0.45, -0.25), (0.45, 0.25), (-0.45, 0.25)], leg, wood);
    let top = 0.443;
    let glaze = Bands(rgb(0x28828c), rgb(0xe6e2ce), rgb(0x143c5a), 9.0);
    let vase = c + v(-0.28, 0.06, top);
    scene.lathe(vase, &[0.05, 0.0, 0.10, 0.10, 0.09, 0.20, 0.04, 0.29, 0.055, 0.34], glossy(glaze));
    for k in 0..7 {
        let angle = f64::from(k) * 51.0;
        let start = vase + DVec3::Z * 0.3;
        let tip = start + polar(0.10 + 0.02 * f64::from(k % 3), angle, 0.20 + 0.05 * f64::from(k * 3 % 4));
        scene.rod(start, tip, 0.008, matt(0x3c7832));
        scene.sphere(tip, 0.042, matt([rgb(0xf65a6e), rgb(0xfcce50), rgb(0xfaf6f0)][k as usize % 3]));
    }
    for (k, colour) in [rgb(0x1e6042), rgb(0xe2d8be), rgb(0x961e24)].into_iter().enumerate() {
        let at = c + v(0.20, 0.04, top + 0.022 + 0.042 * k as f64);
        let part = Convex::block(at, v(0.30 - 0.03 * k as f64, 0.21, 0.040)).turned(18.0 * k as f64 - 8.0);
        scene.solid(part, satin(colour));
    }
    let cup = c + v(-0.02, -0.16, top);
    scene.cylinder(cup, 0.085, 0.012, glossy(0xf0eee8));
    scene.lathe(cup, &[0.03, 0.01, 0.05, 0.05, 0.055, 0.09], glossy(0xf0eee8));
    scene.sphere(c + v(0.33, 0.0, 0.243), 0.07, metal(0xd6a854));
}

/// Adds a dresser along the left wall with a lamp on it.
fn dresser(scene: &mut Builder) {
    let wood = satin(Planks(rgb(0xbe8c54), rgb(0x8c5c32), 0.22, 1.5));
    let front = -SIDE + 0.45;
    scene.block(v(-SIDE + 0.225, 2.9, 0.45), v(0.45, 1.3, 0.76), wood);
    scene.block(v(-SIDE + 0.235, 2.9, 0.845), v(0.50, 1.38, 0.04), wood);
    for (k, y) in [2.48, 2.9, 3.32].into_iter().enumerate() {
        for z in [0.25, 0.62] {
            let paint = [rgb(0xcea064), rgb(0xbe8c54)][(k + usize::from(z > 0.5)) % 2];
            scene.block(v(front, y, z), v(0.03, 0.38, 0.31), satin(paint));
            scene.sphere(v(front + 0.03, y, z), 0.025, metal(0xcea656));
        }
    }
    scene.each([2.3, 3.5], |y| Convex::taper(v(front - 0.06, y, 0.0), v(front - 0.06, y, 0.08), 0.025, 0.04), wood);
    let lamp = v(-SIDE + 0.24, 2.45, 0.865);
    scene.lathe(lamp, &[0.09, 0.0, 0.10, 0.06, 0.05, 0.16, 0.02, 0.24, 0.02, 0.30], glossy(0x1e606e));
    let outline = [0.20, 0.28, 0.17, 0.38, 0.12, 0.50];
    scene.lathe(lamp, &outline, matt(Stripes(rgb(0xfae8be), rgb(0xf0ce96), v(9.0, 0.0, 0.0))));
    scene.cylinder(v(-SIDE + 0.24, 3.25, 0.865), 0.08, 0.04, metal(0xcea656));
    scene.sphere(v(-SIDE + 0.24, 3.25, 1.06), 0.16, glossy(Globe(rgb(0x96a050), rgb(0x3c78b4), 9.0, 0.95)));
}

/// Adds an armchair to the right and a plant behind it.
fn corner(scene: &mut Builder) {
    let pot = v(1.55, 4.0, 0.0);
    let outline = [0.15, 0.0, 0.20, 0.20, 0.22, 0.36];
    scene.lathe(pot, &outline, matt(Bands(rgb(0xc46e46), rgb(0xa05032), rgb(0xdc9664), 6.0)));
    let leaf = satin(Stripes(rgb(0x46963c), rgb(0x286830), v(9.0, 0.0, 0.0)));
    for k in 0..16u32 {
        let angle = f64::from(k) * 137.5;
        let reach = 0.26 + 0.02 * f64::from(k % 4);
        let tall = 0.5 + 0.055 * f64::from(k);
        let start = pot + DVec3::Z * 0.32;
        let curve = |s: f64| start + polar(reach * s * s, angle, tall * s * (1.35 - 0.35 * s));
        scene.tube(curve, 8, 0.016, leaf);
        let tip = LocalFrame::along(curve(1.0), curve(1.0) - curve(0.8));
        scene.lathe(tip, &[0.012, -0.12, 0.05, -0.02, 0.045, 0.06, 0.004, 0.16], leaf);
    }
    let cloth = matt(Flowers(rgb(0xcec4a0), rgb(0x789664), 6.0, false));
    let (x, y) = (1.32, 2.75);
    let turn = |c: Convex| c.swung(v(x, y, 0.0), DVec3::Z, 58.0);
    scene.solid(turn(Convex::block(v(x, y, 0.30), v(0.62, 0.60, 0.26))), cloth);
    let back = Convex::block(v(x, y - 0.27, 0.62), v(0.62, 0.14, 0.66));
    scene.solid(turn(back.swung(v(x, y - 0.27, 0.3), DVec3::X, 10.0)), cloth);
    for side in [-0.33, 0.33] {
        scene.solid(turn(Convex::block(v(x + side, y, 0.40), v(0.12, 0.62, 0.36))), cloth);
        scene.solid(turn(Convex::rod(v(x + side, y - 0.3, 0.58), v(x + side, y + 0.32, 0.58), 0.075)), cloth);
        let leg = |dy: f64| turn(Convex::cylinder(v(x + 0.85 * side, y + dy, 0.0), 0.025, 0.18));
        scene.each([-0.26, 0.26], leg, matt(0x462816));
    }
}
