//! A sitting room seen from within: walls, floor and ceiling are everywhere behind the furniture.

use glam::DVec3;

use super::{flowers, glossy, matt, polar, rgb, satin, stripes, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

const WALL: f64 = 4.4;
const SIDE: f64 = 2.0;
const HIGH: f64 = 2.75;

pub(crate) fn room() -> Builder {
    let mut scene = Builder::default();
    scene.backdrop(true);
    shell(&mut scene);
    on_the_walls(&mut scene);
    scene.backdrop(false);
    sofa(&mut scene);
    low_table(&mut scene);
    dresser(&mut scene);
    corner(&mut scene);
    scene
}

fn shell(scene: &mut Builder) {
    // No light from the floor reaches the ceiling here: its colour stands in for it.
    let (near, thick) = (-1.0, 0.08);
    let (y, deep) = (0.5 * (near + WALL), WALL - near);
    let boards = Texture::Planks { a: rgb(176, 122, 76), b: rgb(122, 76, 42), width: 0.16, length: 1.3 };
    scene.block(v(0.0, y, -0.5 * thick), v(2.0 * SIDE, deep, thick), Material::glossy(boards));
    scene.block(v(0.0, y, HIGH + 0.5 * thick), v(2.0 * SIDE, deep, thick), matt(v(3.4, 3.25, 3.0)));
    let paper = flowers(rgb(92, 136, 134), rgb(206, 206, 170), 4.0, false);
    let plain = stripes(rgb(226, 206, 166), rgb(214, 188, 144), v(0.0, 4.0, 0.0));
    scene.block(v(0.0, WALL + 0.5 * thick, 0.5 * HIGH), v(2.0 * SIDE + 0.2, thick, HIGH + 0.2), Material::matt(paper));
    scene.block(v(0.0, near - 0.5 * thick, 0.5 * HIGH), v(2.0 * SIDE + 0.2, thick, HIGH + 0.2), Material::matt(paper));
    let white = satin(rgb(240, 234, 222));
    for side in [-1.0, 1.0] {
        scene.block(v(side * (SIDE + 0.5 * thick), y, 0.5 * HIGH), v(thick, deep, HIGH + 0.2), Material::matt(plain));
        scene.block(v(side * (SIDE - 0.01), y, 0.07), v(0.03, deep, 0.14), white);
        scene.block(v(side * (SIDE - 0.03), y, HIGH - 0.05), v(0.07, deep, 0.09), white);
    }
    scene.block(v(0.0, WALL - 0.01, 0.07), v(2.0 * SIDE, 0.03, 0.14), white);
    scene.block(v(0.0, WALL - 0.03, HIGH - 0.05), v(2.0 * SIDE, 0.07, 0.09), white);
    let rug = flowers(rgb(150, 36, 44), rgb(236, 196, 120), 4.5, false);
    scene.block(v(0.0, 2.35, 0.006), v(2.3, 1.7, 0.012), Material::matt(rug));
    let border = stripes(rgb(30, 40, 80), rgb(226, 196, 130), v(9.0, 9.0, 0.0));
    scene.block(v(0.0, 2.35, 0.004), v(2.5, 1.9, 0.010), Material::matt(border));
}

fn on_the_walls(scene: &mut Builder) {
    let gold = Material::metal(rgb(196, 150, 76));
    let frame = |scene: &mut Builder, at: DVec3, wide: f64, high: f64, picture: Texture| {
        scene.block(at - DVec3::Y * 0.02, v(wide, 0.05, high), gold);
        scene.block(at - DVec3::Y * 0.035, v(wide - 0.10, 0.03, high - 0.10), matt(rgb(240, 234, 220)));
        scene.block(at - DVec3::Y * 0.04, v(wide - 0.24, 0.03, high - 0.24), Material::satin(picture));
    };
    let sea = Texture::Bands { a: rgb(30, 80, 140), b: rgb(240, 170, 90), c: rgb(250, 226, 170), per_unit: 3.0 };
    frame(scene, v(-0.1, WALL, 1.72), 1.05, 0.75, sea);
    let isles = Texture::Patches { a: rgb(200, 120, 60), b: rgb(60, 110, 120), per_unit: 7.0, cap: 9.0 };
    frame(scene, v(-1.15, WALL, 1.78), 0.55, 0.70, isles);
    // A window in the right wall, with curtains, and a mirror on the left one.
    let sky = Texture::Patches { a: rgb(252, 252, 250), b: rgb(130, 186, 236), per_unit: 2.2, cap: 9.0 };
    scene.block(v(SIDE, 2.7, 1.55), v(0.02, 1.1, 1.3), Material::matt(sky));
    let white = satin(rgb(246, 242, 232));
    for (dy, dz, y, z) in [(0.0, 0.66, 1.24, 0.08), (0.0, -0.66, 1.3, 0.10), (0.0, 0.1, 1.1, 0.05)] {
        scene.block(v(SIDE - 0.03, 2.7 + dy, 1.55 + dz), v(0.08, y, z), white);
    }
    for dy in [-0.57, 0.0, 0.57] {
        scene.block(v(SIDE - 0.03, 2.7 + dy, 1.55), v(0.07, 0.06, 1.36), white);
    }
    let cloth = Material::matt(stripes(rgb(190, 80, 60), rgb(150, 50, 46), v(0.0, 0.0, 3.0)));
    for k in 0..10 {
        let y = if k < 5 { 1.92 + 0.06 * f64::from(k) } else { 3.20 + 0.06 * f64::from(k - 5) };
        scene.cylinder(v(SIDE - 0.08, y, 0.35), 0.045, 1.98, cloth);
    }
    scene.rod(v(SIDE - 0.08, 1.75, 2.36), v(SIDE - 0.08, 3.65, 2.36), 0.022, gold);
    let glass = Material::mirror(rgb(226, 232, 236));
    let at = v(-SIDE, 2.9, 1.6);
    scene.rod(at, at + DVec3::X * 0.03, 0.42, gold);
    scene.rod(at, at + DVec3::X * 0.04, 0.36, glass);
}

fn sofa(scene: &mut Builder) {
    let cloth =
        Material::matt(Texture::Checker { a: rgb(44, 84, 130), b: rgb(36, 70, 112), per_unit: v(9.0, 9.0, 9.0) });
    let (x, y) = (-0.15, 3.75);
    scene.block(v(x, y, 0.26), v(1.9, 0.80, 0.24), cloth);
    scene.block(v(x, y + 0.36, 0.55), v(1.9, 0.22, 0.62), cloth);
    scene.rod(v(x - 0.95, y + 0.36, 0.86), v(x + 0.95, y + 0.36, 0.86), 0.11, cloth);
    for side in [-1.0, 1.0] {
        let arm = x + side * 0.98;
        scene.block(v(arm, y, 0.36), v(0.20, 0.82, 0.44), cloth);
        scene.rod(v(arm, y - 0.41, 0.58), v(arm, y + 0.41, 0.58), 0.12, cloth);
        scene.block(v(x + side * 0.44, y - 0.06, 0.44), v(0.86, 0.70, 0.14), cloth);
        for dy in [-0.34, 0.34] {
            scene.cylinder(v(x + side * 0.9, y + dy, 0.0), 0.03, 0.15, matt(rgb(70, 40, 22)));
        }
    }
    let gold = Material::matt(flowers(rgb(230, 170, 50), rgb(250, 236, 200), 9.0, false));
    let red = Material::matt(stripes(rgb(206, 60, 50), rgb(246, 236, 220), v(9.0, 0.0, 0.0)));
    scene.solid(
        Convex::block(v(x - 0.62, y + 0.12, 0.70), v(0.40, 0.14, 0.40)).swung(v(x - 0.62, y, 0.5), DVec3::X, -18.0),
        gold,
    );
    scene.solid(
        Convex::block(v(x + 0.58, y + 0.12, 0.68), v(0.38, 0.13, 0.38)).swung(v(x + 0.58, y, 0.5), DVec3::X, -20.0),
        red,
    );
}

fn low_table(scene: &mut Builder) {
    let wood = Material::glossy(Texture::Planks { a: rgb(130, 78, 40), b: rgb(86, 46, 22), width: 0.13, length: 1.2 });
    let c = v(0.05, 2.35, 0.0);
    scene.block(c + DVec3::Z * 0.42, v(1.0, 0.58, 0.045), wood);
    scene.block(c + DVec3::Z * 0.16, v(0.88, 0.48, 0.025), wood);
    for (x, y) in [(-0.45, -0.25), (0.45, -0.25), (0.45, 0.25), (-0.45, 0.25)] {
        scene.solid(Convex::taper(c + v(x, y, 0.0), c + v(x, y, 0.40), 0.022, 0.034), wood);
    }
    let top = 0.443;
    let glaze = Texture::Bands { a: rgb(40, 130, 140), b: rgb(230, 226, 206), c: rgb(20, 60, 90), per_unit: 9.0 };
    let vase = LocalFrame::at(c + v(-0.28, 0.06, top));
    scene.lathe(vase, &[(0.05, 0.0), (0.10, 0.10), (0.09, 0.20), (0.04, 0.29), (0.055, 0.34)], Material::glossy(glaze));
    for k in 0..7 {
        let angle = f64::from(k) * 51.0;
        let start = vase.origin + DVec3::Z * 0.3;
        let tip = start + polar(0.10 + 0.02 * f64::from(k % 3), angle, 0.20 + 0.05 * f64::from(k * 3 % 4));
        scene.rod(start, tip, 0.008, matt(rgb(60, 120, 50)));
        let petal = [rgb(246, 90, 110), rgb(252, 206, 80), rgb(250, 246, 240)][k as usize % 3];
        scene.sphere(tip, 0.042, matt(petal));
    }
    for (k, colour) in [rgb(30, 96, 66), rgb(226, 216, 190), rgb(150, 30, 36)].into_iter().enumerate() {
        let at = c + v(0.20, 0.04, top + 0.022 + 0.042 * k as f64);
        scene.solid(
            Convex::block(at, v(0.30 - 0.03 * k as f64, 0.21, 0.040)).turned(18.0 * k as f64 - 8.0),
            satin(colour),
        );
    }
    let cup = c + v(-0.02, -0.16, top);
    scene.cylinder(cup, 0.085, 0.012, glossy(rgb(240, 238, 232)));
    scene.lathe(LocalFrame::at(cup), &[(0.03, 0.01), (0.05, 0.05), (0.055, 0.09)], glossy(rgb(240, 238, 232)));
    scene.sphere(c + v(0.33, 0.0, 0.243), 0.07, Material::metal(rgb(214, 168, 84)));
}

/// Adds a dresser along the left wall with a lamp on it.
fn dresser(scene: &mut Builder) {
    let wood = Material::satin(Texture::Planks { a: rgb(190, 140, 84), b: rgb(140, 92, 50), width: 0.22, length: 1.5 });
    let front = -SIDE + 0.45;
    scene.block(v(-SIDE + 0.225, 2.9, 0.45), v(0.45, 1.3, 0.76), wood);
    scene.block(v(-SIDE + 0.235, 2.9, 0.845), v(0.50, 1.38, 0.04), wood);
    for (k, y) in [2.48, 2.9, 3.32].into_iter().enumerate() {
        for z in [0.25, 0.62] {
            let paint = [rgb(206, 160, 100), rgb(190, 140, 84)][(k + usize::from(z > 0.5)) % 2];
            scene.block(v(front, y, z), v(0.03, 0.38, 0.31), satin(paint));
            scene.sphere(v(front + 0.03, y, z), 0.025, Material::metal(rgb(206, 166, 86)));
        }
    }
    for y in [2.3, 3.5] {
        scene.solid(Convex::taper(v(front - 0.06, y, 0.0), v(front - 0.06, y, 0.08), 0.025, 0.04), wood);
    }
    let lamp = LocalFrame::at(v(-SIDE + 0.24, 2.45, 0.865));
    scene.lathe(lamp, &[(0.09, 0.0), (0.10, 0.06), (0.05, 0.16), (0.02, 0.24), (0.02, 0.30)], glossy(rgb(30, 96, 110)));
    scene.lathe(
        lamp,
        &[(0.20, 0.28), (0.17, 0.38), (0.12, 0.50)],
        Material::matt(stripes(rgb(250, 232, 190), rgb(240, 206, 150), v(9.0, 0.0, 0.0))),
    );
    let globe = Texture::Patches { a: rgb(150, 160, 80), b: rgb(60, 120, 180), per_unit: 9.0, cap: 0.95 };
    scene.cylinder(v(-SIDE + 0.24, 3.25, 0.865), 0.08, 0.04, Material::metal(rgb(206, 166, 86)));
    scene.sphere(v(-SIDE + 0.24, 3.25, 1.06), 0.16, Material::glossy(globe));
}

/// Adds an armchair to the right and a plant behind it.
fn corner(scene: &mut Builder) {
    let pot = LocalFrame::at(v(1.55, 4.0, 0.0));
    scene.lathe(
        pot,
        &[(0.15, 0.0), (0.20, 0.20), (0.22, 0.36)],
        Material::matt(Texture::Bands {
            a: rgb(196, 110, 70),
            b: rgb(160, 80, 50),
            c: rgb(220, 150, 100),
            per_unit: 6.0,
        }),
    );
    let leaf = Material::satin(stripes(rgb(70, 150, 60), rgb(40, 104, 48), v(9.0, 0.0, 0.0)));
    for k in 0..16u32 {
        let angle = f64::from(k) * 137.5;
        let reach = 0.26 + 0.02 * f64::from(k % 4);
        let tall = 0.5 + 0.055 * f64::from(k);
        let start = pot.origin + DVec3::Z * 0.32;
        let curve = |s: f64| start + polar(reach * s * s, angle, tall * s * (1.35 - 0.35 * s));
        scene.closed_tube(curve, 8, 0.016, leaf);
        let tip = curve(1.0);
        scene.lathe(
            LocalFrame::along(tip, curve(1.0) - curve(0.8)),
            &[(0.012, -0.12), (0.05, -0.02), (0.045, 0.06), (0.004, 0.16)],
            leaf,
        );
    }
    let cloth = Material::matt(flowers(rgb(206, 196, 160), rgb(120, 150, 100), 6.0, false));
    let (x, y) = (1.32, 2.75);
    let turn = |c: Convex| c.swung(v(x, y, 0.0), DVec3::Z, 58.0);
    scene.solid(turn(Convex::block(v(x, y, 0.30), v(0.62, 0.60, 0.26))), cloth);
    scene.solid(
        turn(Convex::block(v(x, y - 0.27, 0.62), v(0.62, 0.14, 0.66)).swung(v(x, y - 0.27, 0.3), DVec3::X, 10.0)),
        cloth,
    );
    for side in [-0.33, 0.33] {
        scene.solid(turn(Convex::block(v(x + side, y, 0.40), v(0.12, 0.62, 0.36))), cloth);
        scene.solid(turn(Convex::rod(v(x + side, y - 0.3, 0.58), v(x + side, y + 0.32, 0.58), 0.075)), cloth);
        for dy in [-0.26, 0.26] {
            scene.solid(turn(Convex::cylinder(v(x + 0.85 * side, y + dy, 0.0), 0.025, 0.18)), matt(rgb(70, 40, 22)));
        }
    }
}
