//! The corner of a town house, so near that it runs over the image's edges.

use super::*;

const LOW: f64 = -1.24;
const HALF: f64 = 1.02;
const STOREY: f64 = 0.62;
const STONE: u32 = 0xc0ae90;

pub(super) fn facade(scene: &mut Builder) {
    let pave = Checker(rgb(0x96928a), rgb(0x767470), v(5.0, 5.0, 0.1));
    scene.block(v(0.0, 0.0, LOW - 0.02), v(2.58, 2.58, 0.06), matt(pave));
    body(scene);
    for (number, colour) in (0i32..).zip([0x2e6e54, 0x28568c, 0x962c30, 0x605082]) {
        front(scene, Side::turned(90.0 * f64::from(number)), number, rgb(colour));
    }
    roof(scene);
}

fn body(scene: &mut Builder) {
    let storeys = |from: f64, to: f64| {
        let (low, high) = (LOW + from * STOREY, LOW + to * STOREY);
        Convex::block(v(0.0, 0.0, 0.5 * (low + high)), v(2.0 * HALF, 2.0 * HALF, high - low))
    };
    // Windows are niches.
    let mut cuts = Vec::new();
    let mut doors = Vec::new();
    for side in around(4).map(Side::turned) {
        for column in -2..=2 {
            cuts.extend([1, 2].map(|floor| side.block(window(side, column, floor), 0.24, 0.20, 0.36)));
            doors.push(side.block(window(side, column, 0) - DVec3::Z * 0.03, 0.28, 0.22, 0.40));
        }
    }
    scene.carved(storeys(0.0, 1.0), doors, matt(Bricks(rgb(0xcebea0), rgb(0x786a58), 0.34, 0.14, false)));
    scene.carved(storeys(1.0, 3.0), cuts, matt(Bricks(rgb(0xc4684e), rgb(0xdaccb8), 0.13, 0.06, false)));
}

/// Builds dark glass in which the surroundings are seen.
fn pane() -> Material {
    Material { reflectance: 0.25, ..glossy(0x2e4254) }
}

/// Returns the middle of a window on the wall.
fn window(side: Side, column: i32, floor: u32) -> DVec3 {
    side.out * HALF + side.along * (0.40 * f64::from(column)) + DVec3::Z * (LOW + (f64::from(floor) + 0.5) * STOREY)
}

/// Adds what is on a wall; `number` counts the walls, whose balconies and flowers differ, and `colour` is that of the shutters.
fn front(scene: &mut Builder, side: Side, number: i32, colour: DVec3) {
    let Side { along, out, .. } = side;
    // Cornices over every storey.
    for (floor, deep, high) in [(1.0, 0.07, 0.05), (2.0, 0.045, 0.03), (3.0, 0.13, 0.08)] {
        let centre = out * (HALF + 0.2 * deep) + DVec3::Z * (LOW + floor * STOREY);
        scene.solid(side.block(centre, 2.0 * HALF + deep, deep, high), matt(STONE));
    }
    let dentil = |i: i32| out * (HALF + 0.03) + along * (0.094 * f64::from(i)) + DVec3::Z * (LOW + 3.0 * STOREY - 0.07);
    scene.each(-10..=10, |i| side.block(dentil(i), 0.045, 0.08, 0.06), matt(STONE));
    // Quoins at the corner.
    for k in 0..9 {
        let wide = if k % 2 == 0 { 0.16 } else { 0.10 };
        let z = LOW + STOREY + 0.06 + 0.135 * f64::from(k);
        let aside = along * (HALF - 0.5 * wide + 0.012);
        scene.solid(side.block(out * HALF + aside + DVec3::Z * z, wide, 0.05, 0.10), matt(STONE));
        scene.solid(side.block(out * HALF - aside + DVec3::Z * z, wide, 0.05, 0.10), matt(STONE));
    }
    let frame = matt(0xf4f0e6);
    let shutter = matt(Stripes(colour, colour * 0.5, v(0.0, 0.0, 22.0)));
    for column in -2..=2i32 {
        for floor in 1..=2 {
            let c = window(side, column, floor);
            scene.solid(side.block(c - out * 0.08, 0.26, 0.02, 0.38), pane());
            scene.each([-0.115, 0.0, 0.115], |x| side.block(c - out * 0.06 + along * x, 0.022, 0.03, 0.36), frame);
            scene.each([-0.17, 0.05, 0.17], |z| side.block(c - out * 0.06 + DVec3::Z * z, 0.24, 0.03, 0.022), frame);
            scene.solid(side.block(c + out * 0.02 - DVec3::Z * 0.20, 0.30, 0.10, 0.035), matt(STONE));
            scene.solid(side.block(c + out * 0.015 + DVec3::Z * 0.205, 0.30, 0.06, 0.05), matt(STONE));
            if floor == 1 {
                scene.each([-0.165, 0.165], |x| side.block(c + out * 0.02 + along * x, 0.085, 0.02, 0.36), shutter);
            }
            if floor == 2 && (column + number).rem_euclid(2) == 0 {
                balcony(scene, c - DVec3::Z * 0.18, side);
            } else {
                flowers(scene, c - DVec3::Z * 0.18 + out * 0.05, along, column + number);
            }
        }
        shop(scene, side, column, colour);
    }
}

fn balcony(scene: &mut Builder, at: DVec3, side: Side) {
    let iron = metal(0x32343a);
    scene.solid(side.block(at + side.out * 0.08 - DVec3::Z * 0.02, 0.36, 0.16, 0.03), matt(STONE));
    let corner = |x: f64, y: f64, z: f64| at + side.along * x + side.out * y + DVec3::Z * z;
    let bar = |x: f64| Convex::rod(corner(x, 0.15, 0.0), corner(x, 0.15, 0.15), 0.007);
    scene.each(0..9, |k| bar(-0.17 + 0.0425 * f64::from(k)), iron);
    for z in [0.02, 0.15] {
        scene.rod(corner(-0.17, 0.15, z), corner(0.17, 0.15, z), 0.010, iron);
        scene.each([-0.17, 0.17], |x| Convex::rod(corner(x, 0.0, z), corner(x, 0.15, z), 0.010), iron);
    }
    scene.each([-0.17, 0.17], |x| Convex::rod(corner(x, 0.075, 0.0), corner(x, 0.075, 0.15), 0.007), iron);
}

/// Adds a row of flowers; `number` chooses their colour.
fn flowers(scene: &mut Builder, at: DVec3, along: DVec3, number: i32) {
    let green = matt(Patches(rgb(0x6eaa46), rgb(0x326e32), 20.0));
    let petal = [rgb(0xe2283c), rgb(0xfac83c), rgb(0xe66ebe)][number.rem_euclid(3) as usize];
    for k in -3..=3i32 {
        let place = at + along * (0.036 * f64::from(k));
        scene.sphere(place, 0.026, green);
        scene.sphere(place + DVec3::Z * (0.022 + 0.008 * f64::from(k.rem_euclid(2))), 0.016, matt(petal));
    }
}

/// Adds a door in the middle of the ground floor, shop windows with awnings next to it.
fn shop(scene: &mut Builder, side: Side, column: i32, colour: DVec3) {
    let Side { along, out, .. } = side;
    let c = window(side, column, 0) - DVec3::Z * 0.03;
    if column == 0 {
        scene.solid(side.block(c - out * 0.06, 0.28, 0.02, 0.42), satin(Planks(colour, colour * 0.5, 0.06, 2.0)));
        scene.sphere(c - out * 0.045 + along * 0.09, 0.018, metal(0xe2ba5a));
        for x in [-0.19, 0.19] {
            let foot = c + along * x + out * 0.06 - DVec3::Z * 0.235;
            scene.lathe(foot, &[0.05, 0.0, 0.04, 0.03, 0.034, 0.22, 0.032, 0.38, 0.05, 0.42], matt(STONE));
        }
        scene.solid(side.block(c + out * 0.05 + DVec3::Z * 0.215, 0.50, 0.14, 0.06), matt(STONE));
        scene.solid(side.block(c + out * 0.08 - DVec3::Z * 0.235, 0.40, 0.16, 0.04), matt(STONE));
        return;
    }
    let warm = Checker(rgb(0xface78), rgb(0xbe6e46), v(14.0, 14.0, 11.0));
    scene.solid(side.block(c - out * 0.09, 0.30, 0.02, 0.42), Material { reflectance: 0.10, ..glossy(warm) });
    let frame = matt(colour * 0.6);
    scene.each([-0.135, 0.0, 0.135], |x| side.block(c - out * 0.05 + along * x, 0.02, 0.03, 0.40), frame);
    scene.solid(side.block(c - DVec3::Z * 0.17, 0.28, 0.05, 0.07), frame);
    let cloth = Stripes(colour, rgb(0xf6f0e2), v(14.0, 0.0, 0.0));
    let awning = side.block(c + out * 0.10 + DVec3::Z * 0.20, 0.36, 0.20, 0.012);
    scene.solid(awning.swung(c + out * 0.01 + DVec3::Z * 0.20, along, -32.0), matt(cloth));
}

fn roof(scene: &mut Builder) {
    let z = LOW + 3.0 * STOREY + 0.04;
    let slate = satin(Bricks(rgb(0x606c7e), rgb(0x303642), 0.10, 0.07, false));
    scene.block(v(0.0, 0.0, z + 0.06), v(1.86, 1.86, 0.12), slate);
    scene.block(v(0.0, 0.0, z + 0.17), v(1.60, 1.60, 0.14), slate);
    let tiles = Checker(rgb(0xa86848), rgb(0x7e4a36), v(8.0, 8.0, 0.1));
    scene.block(v(0.0, 0.0, z + 0.24), v(1.50, 1.50, 0.02), matt(tiles));
    for side in around(4).map(Side::turned) {
        let Side { along, out, .. } = side;
        scene.solid(side.block(out * 0.79 + DVec3::Z * (z + 0.27), 1.64, 0.06, 0.08), matt(STONE));
        // Dormers in the roof.
        for x in [-0.55, 0.0, 0.55] {
            let c = out * 0.88 + along * x + DVec3::Z * (z + 0.13);
            scene.solid(side.block(c, 0.24, 0.22, 0.20), matt(STONE));
            scene.solid(side.block(c + out * 0.11, 0.16, 0.01, 0.14), pane());
            scene.rod(c + out * 0.13 + DVec3::Z * 0.08, c - out * 0.12 + DVec3::Z * 0.08, 0.12, slate);
        }
    }
    terrace(scene, z);
    let brick = Bricks(rgb(0xb0543e), rgb(0xcec4b4), 0.09, 0.045, false);
    for (x, y) in [(0.30, 0.56), (-0.60, 0.15), (0.45, -0.5)] {
        scene.block(v(x, y, z + 0.38), v(0.20, 0.16, 0.28), matt(brick));
        scene.each([-0.05, 0.05], |dx| Convex::cylinder(v(x + dx, y, z + 0.50), 0.03, 0.12), matt(0xc46e46));
    }
    let green = matt(Patches(rgb(0x6eaa46), rgb(0x326e32), 12.0));
    for (x, y) in [(-0.5, 0.55), (-0.3, 0.6), (0.0, -0.6), (0.6, -0.1)] {
        scene.cone(v(x, y, z + 0.26), 0.06, 0.08, 0.10, matt(0xc46e46));
        scene.sphere(v(x, y, z + 0.40), 0.10, green);
    }
}

/// Adds a skylight, a sunshade with a table, and a bed of herbs.
fn terrace(scene: &mut Builder, z: f64) {
    let pane = Material { reflectance: 0.20, ..glossy(0x466e82) };
    let white = satin(0xc8c8c4);
    for side in [-1.0, 1.0] {
        let leaf = Convex::block(v(-0.05 + side * 0.10, 0.10, z + 0.32), v(0.24, 0.50, 0.015));
        scene.solid(leaf.swung(v(-0.05 + side * 0.10, 0.10, z + 0.32), DVec3::Y, side * 38.0), pane);
        scene.block(v(-0.05 + side * 0.20, 0.10, z + 0.27), v(0.03, 0.54, 0.06), white);
    }
    for y in [-0.15, 0.02, 0.18, 0.35] {
        scene.each([-0.25, 0.15], |x| Convex::rod(v(x, y, z + 0.26), v(-0.05, y, z + 0.41), 0.012), white);
    }
    scene.cone(v(-0.45, -0.42, z + 0.44), 0.20, 0.0, 0.10, matt(Shingles(rgb(0xce2c32), rgb(0xf0dcb4), 12.0, 3.0)));
    scene.cylinder(v(-0.45, -0.42, z + 0.24), 0.012, 0.22, white);
    scene.cylinder(v(-0.45, -0.42, z + 0.31), 0.10, 0.015, white);
    scene.block(v(0.60, 0.40, z + 0.27), v(0.16, 0.52, 0.07), matt(Plain(rgb(0x78502e))));
    scene.block(v(0.60, 0.40, z + 0.31), v(0.13, 0.49, 0.03), matt(Patches(rgb(0x82b446), rgb(0x3c6e32), 22.0)));
}
