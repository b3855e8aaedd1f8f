//! The corner of a town house, so near that it runs over the image's edges.

use glam::DVec3;

use super::{bricks, glossy, matt, polar, rgb, satin, stripes, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

const LOW: f64 = -1.24;
const HALF: f64 = 1.02;
const STOREY: f64 = 0.62;

pub(crate) fn facade() -> Builder {
    let mut scene = Builder::default();
    let pave = Texture::Checker { a: rgb(150, 146, 138), b: rgb(118, 116, 112), per_unit: v(5.0, 5.0, 0.1) };
    scene.block(v(0.0, 0.0, LOW - 0.02), v(2.58, 2.58, 0.06), Material::matt(pave));
    body(&mut scene);
    for side in 0..4u32 {
        front(&mut scene, side);
    }
    roof(&mut scene);
    scene
}

fn stone() -> Material {
    matt(rgb(192, 174, 144))
}

fn body(scene: &mut Builder) {
    let brick = bricks(rgb(196, 104, 78), rgb(218, 204, 184), [0.13, 0.06], false);
    let rustic = bricks(rgb(206, 190, 160), rgb(120, 106, 88), [0.34, 0.14], false);
    let storeys = |from: f64, to: f64| {
        let (low, high) = (LOW + from * STOREY, LOW + to * STOREY);
        Convex::block(v(0.0, 0.0, 0.5 * (low + high)), v(2.0 * HALF, 2.0 * HALF, high - low))
    };
    // Windows are niches.
    let mut cuts = Vec::new();
    let mut doors = Vec::new();
    for side in 0..4 {
        let turn = f64::from(side) * 90.0;
        for column in -2..=2 {
            for floor in 1..=2 {
                let centre = window(side, column, floor);
                cuts.push(Convex::block(centre, v(0.24, 0.20, 0.36)).turned(turn));
            }
            let centre = window(side, column, 0);
            doors.push(Convex::block(centre - DVec3::Z * 0.03, v(0.28, 0.22, 0.40)).turned(turn));
        }
    }
    scene.carved(storeys(0.0, 1.0), doors, Material::matt(rustic));
    scene.carved(storeys(1.0, 3.0), cuts, Material::matt(brick));
}

/// Returns the middle of a window on the wall.
fn window(side: u32, column: i32, floor: u32) -> DVec3 {
    let turn = f64::from(side) * 90.0;
    polar(HALF, turn - 90.0, LOW + (f64::from(floor) + 0.5) * STOREY) + polar(0.40 * f64::from(column), turn, 0.0)
}

fn front(scene: &mut Builder, side: u32) {
    let turn = f64::from(side) * 90.0;
    let (along, out) = (polar(1.0, turn, 0.0), polar(1.0, turn - 90.0, 0.0));
    let block = |centre: DVec3, x: f64, y: f64, z: f64| Convex::block(centre, v(x, y, z)).turned(turn);
    // Cornices over every storey.
    for (floor, deep, high) in [(1.0, 0.07, 0.05), (2.0, 0.045, 0.03), (3.0, 0.13, 0.08)] {
        scene.solid(
            block(out * (HALF + 0.2 * deep) + DVec3::Z * (LOW + floor * STOREY), 2.0 * HALF + deep, deep, high),
            stone(),
        );
    }
    let dentil = |i: i32| out * (HALF + 0.03) + along * (0.094 * f64::from(i)) + DVec3::Z * (LOW + 3.0 * STOREY - 0.07);
    for i in -10..=10 {
        scene.solid(block(dentil(i), 0.045, 0.08, 0.06), stone());
    }
    // Quoins at the corner.
    for k in 0..9 {
        let wide = if k % 2 == 0 { 0.16 } else { 0.10 };
        let z = LOW + STOREY + 0.06 + 0.135 * f64::from(k);
        scene.solid(block(out * HALF + along * (HALF - 0.5 * wide + 0.012) + DVec3::Z * z, wide, 0.05, 0.10), stone());
        scene.solid(block(out * HALF - along * (HALF - 0.5 * wide + 0.012) + DVec3::Z * z, wide, 0.05, 0.10), stone());
    }
    let glass = Material { reflectance: 0.25, ..glossy(rgb(46, 66, 84)) };
    let frame = matt(rgb(244, 240, 230));
    let shutter_colour = [rgb(46, 110, 84), rgb(40, 86, 140), rgb(150, 44, 48), rgb(96, 80, 130)][side as usize];
    let shutter = Material::matt(stripes(shutter_colour, shutter_colour * 0.5, v(0.0, 0.0, 22.0)));
    for column in -2..=2i32 {
        for floor in 1..=2 {
            let c = window(side, column, floor);
            scene.solid(block(c - out * 0.08, 0.26, 0.02, 0.38), glass);
            for x in [-0.115, 0.0, 0.115] {
                scene.solid(block(c - out * 0.06 + along * x, 0.022, 0.03, 0.36), frame);
            }
            for z in [-0.17, 0.05, 0.17] {
                scene.solid(block(c - out * 0.06 + DVec3::Z * z, 0.24, 0.03, 0.022), frame);
            }
            scene.solid(block(c + out * 0.02 - DVec3::Z * 0.20, 0.30, 0.10, 0.035), stone());
            scene.solid(block(c + out * 0.015 + DVec3::Z * 0.205, 0.30, 0.06, 0.05), stone());
            if floor == 1 {
                for x in [-0.165, 0.165] {
                    scene.solid(block(c + out * 0.02 + along * x, 0.085, 0.02, 0.36), shutter);
                }
            }
            if floor == 2 && (column + side as i32).rem_euclid(2) == 0 {
                balcony(scene, c - DVec3::Z * 0.18, along, out, turn);
            } else {
                flowers(scene, c - DVec3::Z * 0.18 + out * 0.05, along, column + side as i32);
            }
        }
        shop(scene, side, column, shutter_colour);
    }
}

fn balcony(scene: &mut Builder, at: DVec3, along: DVec3, out: DVec3, turn: f64) {
    let iron = Material::metal(rgb(50, 52, 58));
    scene.solid(Convex::block(at + out * 0.08 - DVec3::Z * 0.02, v(0.36, 0.16, 0.03)).turned(turn), stone());
    let corner = |x: f64, y: f64, z: f64| at + along * x + out * y + DVec3::Z * z;
    for k in 0..9 {
        let x = -0.17 + 0.0425 * f64::from(k);
        scene.rod(corner(x, 0.15, 0.0), corner(x, 0.15, 0.15), 0.007, iron);
    }
    for z in [0.02, 0.15] {
        scene.rod(corner(-0.17, 0.15, z), corner(0.17, 0.15, z), 0.010, iron);
        for x in [-0.17, 0.17] {
            scene.rod(corner(x, 0.0, z), corner(x, 0.15, z), 0.010, iron);
        }
    }
    for x in [-0.17, 0.17] {
        scene.rod(corner(x, 0.075, 0.0), corner(x, 0.075, 0.15), 0.007, iron);
    }
}

fn flowers(scene: &mut Builder, at: DVec3, along: DVec3, key: i32) {
    let green =
        Material::matt(Texture::Patches { a: rgb(110, 170, 70), b: rgb(50, 110, 50), per_unit: 20.0, cap: 9.0 });
    let petal = [rgb(226, 40, 60), rgb(250, 200, 60), rgb(230, 110, 190)][key.rem_euclid(3) as usize];
    for k in -3..=3i32 {
        let place = at + along * (0.036 * f64::from(k));
        scene.sphere(place, 0.026, green);
        scene.sphere(place + DVec3::Z * (0.022 + 0.008 * f64::from(k.rem_euclid(2))), 0.016, matt(petal));
    }
}

/// Adds a door in the middle of the ground floor, shop windows with awnings next to it.
fn shop(scene: &mut Builder, side: u32, column: i32, colour: DVec3) {
    let turn = f64::from(side) * 90.0;
    let (along, out) = (polar(1.0, turn, 0.0), polar(1.0, turn - 90.0, 0.0));
    let block = |centre: DVec3, x: f64, y: f64, z: f64| Convex::block(centre, v(x, y, z)).turned(turn);
    let c = window(side, column, 0) - DVec3::Z * 0.03;
    if column == 0 {
        let door = Texture::Planks { a: colour, b: colour * 0.5, width: 0.06, length: 2.0 };
        scene.solid(block(c - out * 0.06, 0.28, 0.02, 0.42), Material::satin(door));
        scene.sphere(c - out * 0.045 + along * 0.09, 0.018, Material::metal(rgb(226, 186, 90)));
        for x in [-0.19, 0.19] {
            let foot = c + along * x + out * 0.06 - DVec3::Z * 0.235;
            scene.lathe(
                LocalFrame::at(foot),
                &[(0.05, 0.0), (0.04, 0.03), (0.034, 0.22), (0.032, 0.38), (0.05, 0.42)],
                stone(),
            );
        }
        scene.solid(block(c + out * 0.05 + DVec3::Z * 0.215, 0.50, 0.14, 0.06), stone());
        scene.solid(block(c + out * 0.08 - DVec3::Z * 0.235, 0.40, 0.16, 0.04), stone());
        return;
    }
    let warm = Texture::Checker { a: rgb(250, 206, 120), b: rgb(190, 110, 70), per_unit: v(14.0, 14.0, 11.0) };
    scene.solid(block(c - out * 0.09, 0.30, 0.02, 0.42), Material { reflectance: 0.10, ..Material::glossy(warm) });
    let frame = matt(colour * 0.6);
    for x in [-0.135, 0.0, 0.135] {
        scene.solid(block(c - out * 0.05 + along * x, 0.02, 0.03, 0.40), frame);
    }
    scene.solid(block(c - DVec3::Z * 0.17, 0.28, 0.05, 0.07), frame);
    let cloth = stripes(colour, rgb(246, 240, 226), v(14.0, 0.0, 0.0));
    let awning = block(c + out * 0.10 + DVec3::Z * 0.20, 0.36, 0.20, 0.012);
    scene.solid(awning.swung(c + out * 0.01 + DVec3::Z * 0.20, along, -32.0), Material::matt(cloth));
}

fn roof(scene: &mut Builder) {
    let z = LOW + 3.0 * STOREY + 0.04;
    let slate = Material::satin(bricks(rgb(96, 108, 126), rgb(48, 54, 66), [0.10, 0.07], false));
    scene.block(v(0.0, 0.0, z + 0.06), v(1.86, 1.86, 0.12), slate);
    scene.block(v(0.0, 0.0, z + 0.17), v(1.60, 1.60, 0.14), slate);
    let tiles = Texture::Checker { a: rgb(168, 104, 72), b: rgb(126, 74, 54), per_unit: v(8.0, 8.0, 0.1) };
    scene.block(v(0.0, 0.0, z + 0.24), v(1.50, 1.50, 0.02), Material::matt(tiles));
    for side in 0..4 {
        let turn = f64::from(side) * 90.0;
        let (along, out) = (polar(1.0, turn, 0.0), polar(1.0, turn - 90.0, 0.0));
        let parapet = Convex::block(out * 0.79 + DVec3::Z * (z + 0.27), v(1.64, 0.06, 0.08));
        scene.solid(parapet.turned(turn), stone());
        // Dormers in the roof.
        for x in [-0.55, 0.0, 0.55] {
            let c = out * 0.88 + along * x + DVec3::Z * (z + 0.13);
            scene.solid(Convex::block(c, v(0.24, 0.22, 0.20)).turned(turn), stone());
            let pane = Material { reflectance: 0.25, ..glossy(rgb(46, 66, 84)) };
            scene.solid(Convex::block(c + out * 0.11, v(0.16, 0.01, 0.14)).turned(turn), pane);
            scene.rod(c + out * 0.13 + DVec3::Z * 0.08, c - out * 0.12 + DVec3::Z * 0.08, 0.12, slate);
        }
    }
    terrace(scene, z);
    let brick = bricks(rgb(176, 84, 62), rgb(206, 196, 180), [0.09, 0.045], false);
    for (x, y) in [(0.30, 0.56), (-0.60, 0.15), (0.45, -0.5)] {
        scene.block(v(x, y, z + 0.38), v(0.20, 0.16, 0.28), Material::matt(brick));
        for dx in [-0.05, 0.05] {
            scene.cylinder(v(x + dx, y, z + 0.50), 0.03, 0.12, matt(rgb(196, 110, 70)));
        }
    }
    let green =
        Material::matt(Texture::Patches { a: rgb(110, 170, 70), b: rgb(50, 110, 50), per_unit: 12.0, cap: 9.0 });
    for (x, y) in [(-0.5, 0.55), (-0.3, 0.6), (0.0, -0.6), (0.6, -0.1)] {
        scene.cone(v(x, y, z + 0.26), 0.06, 0.08, 0.10, matt(rgb(196, 110, 70)));
        scene.sphere(v(x, y, z + 0.40), 0.10, green);
    }
}

/// Adds a skylight, a sunshade with a table, and a bed of herbs.
fn terrace(scene: &mut Builder, z: f64) {
    let pane = Material { reflectance: 0.20, ..glossy(rgb(70, 110, 130)) };
    let white = satin(rgb(200, 200, 196));
    for side in [-1.0, 1.0] {
        let leaf = Convex::block(v(-0.05 + side * 0.10, 0.10, z + 0.32), v(0.24, 0.50, 0.015));
        scene.solid(leaf.swung(v(-0.05 + side * 0.10, 0.10, z + 0.32), DVec3::Y, side * 38.0), pane);
        scene.block(v(-0.05 + side * 0.20, 0.10, z + 0.27), v(0.03, 0.54, 0.06), white);
    }
    for y in [-0.15, 0.02, 0.18, 0.35] {
        for x in [-0.25, 0.15] {
            scene.rod(v(x, y, z + 0.26), v(-0.05, y, z + 0.41), 0.012, white);
        }
    }
    let shade = Texture::Shingles { a: rgb(206, 44, 50), b: rgb(240, 220, 180), around: 12.0, per_unit: 3.0 };
    scene.cone(v(-0.45, -0.42, z + 0.44), 0.20, 0.0, 0.10, Material::matt(shade));
    scene.cylinder(v(-0.45, -0.42, z + 0.24), 0.012, 0.22, white);
    scene.cylinder(v(-0.45, -0.42, z + 0.31), 0.10, 0.015, white);
    let herbs = Texture::Patches { a: rgb(130, 180, 70), b: rgb(60, 110, 50), per_unit: 22.0, cap: 9.0 };
    let wood = Texture::Plain(rgb(120, 80, 46));
    scene.block(v(0.60, 0.40, z + 0.27), v(0.16, 0.52, 0.07), Material::matt(wood));
    scene.block(v(0.60, 0.40, z + 0.31), v(0.13, 0.49, 0.03), Material::matt(herbs));
}
