//! A still life on a table before a papered wall: no part of the image is empty.

use super::*;

const TOP: f64 = -0.72;

pub(super) fn table(scene: &mut Builder) {
    scene.backdrop(true);
    scene.block(v(0.0, -0.2, TOP - 0.1), v(8.2, 5.6, 0.2), satin(Planks(rgb(0x96643c), rgb(0x603a20), 0.26, 2.6)));
    let cloth = Checker(rgb(0xe2dece), rgb(0x8caab0), v(7.0, 7.0, 0.1));
    scene.solid(Convex::block(v(0.0, 0.0, TOP + 0.003), v(1.9, 1.5, 0.008)).turned(14.0), matt(cloth));
    let paper = Flowers(rgb(0xd6be8c), rgb(0x966046), 2.2, false);
    scene.block(v(0.0, 2.5, 1.2), v(8.2, 0.2, 4.6), matt(paper));
    scene.block(v(0.0, 2.38, TOP + 0.12), v(8.2, 0.06, 0.24), satin(0xece6d8));
    for side in [-4.0, 4.0] {
        scene.block(v(side, -0.2, 1.2), v(0.2, 5.6, 4.6), matt(paper));
        scene.block(v(side * 0.97, -0.2, TOP + 0.12), v(0.06, 5.6, 0.24), satin(0xece6d8));
    }
    scene.backdrop(false);
    bowl(scene);
    jug(scene);
    radio(scene);
}

/// Adds a bowl of fruit.
fn bowl(scene: &mut Builder) {
    let at = v(-0.18, -0.36, TOP + 0.006);
    let blue = Flowers(rgb(0xf0f0ea), rgb(0x2854a0), 9.0, true);
    scene.lathe(at, &[0.14, 0.0, 0.13, 0.04, 0.26, 0.11, 0.34, 0.22], glossy(blue));
    scene.ring(at + DVec3::Z * 0.22, 0.335, 0.014, glossy(0x2854a0));
    let apple = |a: DVec3, b: DVec3| glossy(Bands(a, b, a.lerp(b, 0.5), 5.0));
    let red = apple(rgb(0xce1e24), rgb(0xf0963c));
    let green = apple(rgb(0x82b428), rgb(0xd2d250));
    let orange = satin(Patches(rgb(0xfa961e), rgb(0xf08214), 30.0));
    for (angle, z, material) in
        [(0.0, 0.25, red), (75.0, 0.26, orange), (150.0, 0.25, green), (222.0, 0.25, orange), (290.0, 0.25, red)]
    {
        scene.sphere(at + polar(0.19, angle, z), 0.115, material);
    }
    scene.sphere(at + v(0.01, 0.02, 0.38), 0.12, green);
    for (angle, z) in [(0.0, 0.37), (290.0, 0.37), (45.0, 0.505)] {
        let foot = at + polar(if z > 0.5 { 0.0 } else { 0.19 }, angle, z - 0.01);
        scene.rod(foot, foot + v(0.02, 0.01, 0.06), 0.008, matt(0x5a3c1e));
    }
}

/// Adds a copper jug with dried poppies.
fn jug(scene: &mut Builder) {
    let at = v(-0.46, 0.30, TOP + 0.006);
    let copper = Material { reflectance: 0.7, ..metal(0xce744c) };
    scene.lathe(at, &[0.16, 0.0, 0.24, 0.16, 0.22, 0.34, 0.12, 0.52, 0.11, 0.60, 0.15, 0.70], copper);
    scene.ring(at + DVec3::Z * 0.70, 0.145, 0.012, copper);
    let handle = |s: f64| {
        let (sin, cos) = (std::f64::consts::PI * (s - 0.5)).sin_cos();
        at + v(-0.15 - 0.20 * cos, 0.0, 0.42 - 0.22 * sin)
    };
    scene.tube(handle, 20, 0.026, copper);
    for k in 0..9u32 {
        let angle = f64::from(k) * 137.5;
        let start = at + DVec3::Z * 0.62;
        let tall = 0.50 + 0.07 * f64::from(k * 5 % 6);
        let curve = |s: f64| start + polar(0.07 * s + 0.22 * s * s, angle, tall * s);
        scene.tube(curve, 7, 0.010, matt(0x968c50));
        let head = LocalFrame::along(curve(1.0), curve(1.0) - curve(0.9));
        let hue = [rgb(0xc8a05a), rgb(0xe25a3c), rgb(0xf0dcb4)][k as usize % 3];
        scene.lathe(head, &[0.012, -0.01, 0.05, 0.03, 0.055, 0.07, 0.03, 0.105, 0.045, 0.12], matt(hue));
    }
}

/// Adds a small radio and two books.
fn radio(scene: &mut Builder) {
    let (at, side) = (v(0.50, 0.10, TOP + 0.006), Side::turned(-24.0));
    let Side { along, out, turn } = side;
    for (k, colour) in [rgb(0x184278), rgb(0xce962c)].into_iter().enumerate() {
        let c = at + DVec3::Z * (0.035 + 0.066 * k as f64);
        let book = Convex::block(c, v(0.72 - 0.08 * k as f64, 0.44, 0.062)).turned(turn + 8.0 - 12.0 * k as f64);
        scene.solid(book, satin(colour));
    }
    let c = at + DVec3::Z * 0.345;
    scene.solid(side.block(c, 0.64, 0.26, 0.42), glossy(Bands(rgb(0xa05428), rgb(0x6e3418), rgb(0xbe743c), 7.0)));
    let face = c + out * 0.13;
    let grille = Checker(rgb(0xd6b478), rgb(0x6e5432), v(26.0, 1.0, 26.0));
    scene.solid(side.block(face - along * 0.13, 0.30, 0.02, 0.32), matt(grille));
    let dial = Stripes(rgb(0xf4eac8), rgb(0x968264), v(34.0, 0.0, 0.0));
    scene.solid(side.block(face + along * 0.17 + DVec3::Z * 0.10, 0.23, 0.02, 0.12), glossy(dial));
    let brass = metal(0xdcb05a);
    let knob = |x: f64| face + along * x - DVec3::Z * 0.08;
    scene.each([0.11, 0.23], |x| Convex::rod(knob(x), knob(x) + out * 0.05, 0.045), brass);
    scene.rod(c + along * 0.28 + DVec3::Z * 0.2, c + along * 0.46 + DVec3::Z * 0.72, 0.010, brass);
    scene.sphere(c + along * 0.46 + DVec3::Z * 0.72, 0.02, brass);
    let pear = glossy(Patches(rgb(0xdcc846), rgb(0xbeaa32), 20.0));
    let outline = [0.05, 0.0, 0.11, 0.06, 0.11, 0.13, 0.055, 0.23, 0.04, 0.27, 0.004, 0.29];
    scene.lathe(v(0.36, -0.48, TOP + 0.006), &outline, pear);
}
