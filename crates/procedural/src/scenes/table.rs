//! A still life on a table before a papered wall: no part of the image is empty.

use glam::DVec3;

use super::{flowers, glossy, matt, polar, rgb, satin, stripes, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

const TOP: f64 = -0.72;

pub(crate) fn table() -> Builder {
    let mut scene = Builder::default();
    scene.backdrop(true);
    let boards = Texture::Planks { a: rgb(150, 100, 60), b: rgb(96, 58, 32), width: 0.26, length: 2.6 };
    scene.block(v(0.0, -0.2, TOP - 0.1), v(8.2, 5.6, 0.2), Material::satin(boards));
    let cloth = Texture::Checker { a: rgb(226, 222, 206), b: rgb(140, 170, 176), per_unit: v(7.0, 7.0, 0.1) };
    scene.solid(Convex::block(v(0.0, 0.0, TOP + 0.003), v(1.9, 1.5, 0.008)).turned(14.0), Material::matt(cloth));
    let paper = flowers(rgb(214, 190, 140), rgb(150, 96, 70), 2.2, false);
    scene.block(v(0.0, 2.5, 1.2), v(8.2, 0.2, 4.6), Material::matt(paper));
    scene.block(v(0.0, 2.38, TOP + 0.12), v(8.2, 0.06, 0.24), satin(rgb(236, 230, 216)));
    for side in [-4.0, 4.0] {
        scene.block(v(side, -0.2, 1.2), v(0.2, 5.6, 4.6), Material::matt(paper));
        let skirting = Convex::block(v(side * 0.97, -0.2, TOP + 0.12), v(0.06, 5.6, 0.24));
        scene.solid(skirting, satin(rgb(236, 230, 216)));
    }
    scene.backdrop(false);
    bowl(&mut scene);
    jug(&mut scene);
    radio(&mut scene);
    scene
}

/// Adds a bowl of fruit.
fn bowl(scene: &mut Builder) {
    let at = v(-0.18, -0.36, TOP + 0.006);
    let blue = flowers(rgb(240, 240, 234), rgb(40, 84, 160), 9.0, true);
    scene.lathe(LocalFrame::at(at), &[(0.14, 0.0), (0.13, 0.04), (0.26, 0.11), (0.34, 0.22)], Material::glossy(blue));
    scene.ring(LocalFrame::at(at + DVec3::Z * 0.22), 0.335, 0.014, glossy(rgb(40, 84, 160)));
    let apple = |a: DVec3, b: DVec3| Material::glossy(Texture::Bands { a, b, c: a.lerp(b, 0.5), per_unit: 5.0 });
    let red = apple(rgb(206, 30, 36), rgb(240, 150, 60));
    let green = apple(rgb(130, 180, 40), rgb(210, 210, 80));
    let orange =
        Material::satin(Texture::Patches { a: rgb(250, 150, 30), b: rgb(240, 130, 20), per_unit: 30.0, cap: 9.0 });
    for (angle, r, z, material) in [
        (0.0, 0.19, 0.25, red),
        (75.0, 0.19, 0.26, orange),
        (150.0, 0.19, 0.25, green),
        (222.0, 0.19, 0.25, orange),
        (290.0, 0.19, 0.25, red),
    ] {
        scene.sphere(at + polar(r, angle, z), 0.115, material);
    }
    scene.sphere(at + v(0.01, 0.02, 0.38), 0.12, green);
    for (angle, z) in [(0.0, 0.37), (290.0, 0.37), (45.0, 0.505)] {
        let foot = at + polar(if z > 0.5 { 0.0 } else { 0.19 }, angle, z - 0.01);
        scene.rod(foot, foot + v(0.02, 0.01, 0.06), 0.008, matt(rgb(90, 60, 30)));
    }
}

/// Adds a copper jug with dried poppies.
fn jug(scene: &mut Builder) {
    let at = v(-0.46, 0.30, TOP + 0.006);
    let copper = Material { reflectance: 0.7, ..Material::metal(rgb(206, 116, 76)) };
    scene.lathe(
        LocalFrame::at(at),
        &[(0.16, 0.0), (0.24, 0.16), (0.22, 0.34), (0.12, 0.52), (0.11, 0.60), (0.15, 0.70)],
        copper,
    );
    scene.ring(LocalFrame::at(at + DVec3::Z * 0.70), 0.145, 0.012, copper);
    let handle = |s: f64| {
        let (sin, cos) = (std::f64::consts::PI * (s - 0.5)).sin_cos();
        at + v(-0.15 - 0.20 * cos, 0.0, 0.42 - 0.22 * sin)
    };
    scene.closed_tube(handle, 20, 0.026, copper);
    for k in 0..9u32 {
        let angle = f64::from(k) * 137.5;
        let start = at + DVec3::Z * 0.62;
        let tall = 0.50 + 0.07 * f64::from(k * 5 % 6);
        let curve = |s: f64| start + polar(0.07 * s + 0.22 * s * s, angle, tall * s);
        scene.closed_tube(curve, 7, 0.010, matt(rgb(150, 140, 80)));
        let head = LocalFrame::along(curve(1.0), curve(1.0) - curve(0.9));
        let hue = [rgb(200, 160, 90), rgb(226, 90, 60), rgb(240, 220, 180)][k as usize % 3];
        scene.lathe(head, &[(0.012, -0.01), (0.05, 0.03), (0.055, 0.07), (0.03, 0.105), (0.045, 0.12)], matt(hue));
    }
}

/// Adds a small radio and two books.
fn radio(scene: &mut Builder) {
    let (at, turn) = (v(0.50, 0.10, TOP + 0.006), -24.0);
    let (along, out) = (polar(1.0, turn, 0.0), polar(1.0, turn - 90.0, 0.0));
    let block = |c: DVec3, x: f64, y: f64, z: f64| Convex::block(c, v(x, y, z)).turned(turn);
    for (k, colour) in [rgb(24, 66, 120), rgb(206, 150, 44)].into_iter().enumerate() {
        let c = at + DVec3::Z * (0.035 + 0.066 * k as f64);
        let book = Convex::block(c, v(0.72 - 0.08 * k as f64, 0.44, 0.062)).turned(turn + 8.0 - 12.0 * k as f64);
        scene.solid(book, satin(colour));
    }
    let c = at + DVec3::Z * 0.345;
    let wood = Texture::Bands { a: rgb(160, 84, 40), b: rgb(110, 52, 24), c: rgb(190, 116, 60), per_unit: 7.0 };
    scene.solid(block(c, 0.64, 0.26, 0.42), Material::glossy(wood));
    let face = c + out * 0.13;
    let grille = Texture::Checker { a: rgb(214, 180, 120), b: rgb(110, 84, 50), per_unit: v(26.0, 1.0, 26.0) };
    scene.solid(block(face - along * 0.13, 0.30, 0.02, 0.32), Material::matt(grille));
    let dial = stripes(rgb(244, 234, 200), rgb(150, 130, 100), v(34.0, 0.0, 0.0));
    scene.solid(block(face + along * 0.17 + DVec3::Z * 0.10, 0.23, 0.02, 0.12), Material::glossy(dial));
    let brass = Material::metal(rgb(220, 176, 90));
    for x in [0.11, 0.23] {
        let knob = face + along * x - DVec3::Z * 0.08;
        scene.rod(knob, knob + out * 0.05, 0.045, brass);
    }
    scene.rod(c + along * 0.28 + DVec3::Z * 0.2, c + along * 0.46 + DVec3::Z * 0.72, 0.010, brass);
    scene.sphere(c + along * 0.46 + DVec3::Z * 0.72, 0.02, brass);
    let pear =
        Material::glossy(Texture::Patches { a: rgb(220, 200, 70), b: rgb(190, 170, 50), per_unit: 20.0, cap: 9.0 });
    scene.lathe(
        LocalFrame::at(v(0.36, -0.48, TOP + 0.006)),
        &[(0.05, 0.0), (0.11, 0.06), (0.11, 0.13), (0.055, 0.23), (0.04, 0.27), (0.004, 0.29)],
        pear,
    );
}
