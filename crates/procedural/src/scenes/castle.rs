//! A walled castle with a keep: masonry, battlements, windows, a gate with a portcullis.

use super::*;

const FLOOR: f64 = -0.92;
/// Distance of the walls from the middle.
const SIDE: f64 = 0.78;

pub(super) fn castle(scene: &mut Builder) {
    island(scene);
    for (k, (x, y)) in CORNERS.into_iter().enumerate() {
        tower(scene, v(x * SIDE, y * SIDE, FLOOR), 0.62 + 0.16 * (k % 3) as f64, ROOFS[k]);
    }
    walls(scene);
    gate(scene);
    keep(scene);
    yard(scene);
}

const ROOFS: [u32; 4] = [0xc43c2c, 0x2860a0, 0xd69628, 0x3c8c60];

fn stone(round: bool) -> Material {
    matt(Bricks(rgb(0xbab09c), rgb(0x605a52), 0.14, 0.075, round))
}

fn roof(colour: u32) -> Material {
    let a = rgb(colour);
    glossy(Shingles(a, a * 0.45, 16.0, 14.0))
}

fn island(scene: &mut Builder) {
    scene.cone(v(0.0, 0.0, -1.12), 0.90, 1.20, 0.2, matt(Patches(rgb(0x60963e), rgb(0x46702e), 6.0)));
    scene.block(v(0.0, 0.0, FLOOR), v(1.5, 1.5, 0.03), matt(Checker(rgb(0x968c7c), rgb(0x686058), v(9.0, 9.0, 0.1))));
}

/// Adds a round tower with arrow slits, battlements and a pointed roof with a flag.
fn tower(scene: &mut Builder, foot: DVec3, height: f64, colour: u32) {
    let radius = 0.19;
    let mut cuts = vec![Convex::cylinder(foot + DVec3::Z * 0.05, radius - 0.05, height - 0.12)];
    let slit = |angle| Convex::block(foot + polar(0.2, angle, height * 0.62), v(0.30, 0.05, 0.14)).turned(angle);
    cuts.extend(around(4).map(|angle| slit(45.0 + angle)));
    scene.carved(Convex::cylinder(foot, radius, height), cuts, stone(true));
    scene.cone(foot + DVec3::Z * (height - 0.06), radius, radius + 0.05, 0.07, stone(true));
    scene.cone(foot + DVec3::Z * (height + 0.01), radius + 0.06, 0.0, 0.40, roof(colour));
    let tip = foot + DVec3::Z * (height + 0.36);
    scene.rod(tip, tip + DVec3::Z * 0.26, 0.010, metal(0xc8c8be));
    let flag = Stripes(rgb(0xfafaf5), rgb(colour), v(0.0, 0.0, 18.0));
    scene.block(tip + v(0.085, 0.0, 0.19), v(0.16, 0.012, 0.11), matt(flag));
}

/// Adds four walls with battlements; the front one has an arched gate.
fn walls(scene: &mut Builder) {
    for angle in around(4) {
        let side = Side::turned(angle);
        let centre = polar(SIDE, angle - 90.0, FLOOR + 0.20);
        let cuts = if angle == 0.0 {
            let gate = Convex::block(v(0.0, -SIDE, FLOOR + 0.10), v(0.30, 0.4, 0.22));
            vec![gate, Convex::rod(centre - DVec3::Y, centre + DVec3::Y * 0.3, 0.15)]
        } else {
            let hole = centre + DVec3::Z * 0.04;
            vec![Convex::rod(hole - side.out * 0.2, hole + side.out * 0.2, 0.07)]
        };
        scene.carved(side.block(centre, 1.3, 0.11, 0.42), cuts, stone(false));
        let merlon = |i: i32| centre + side.along * (f64::from(i) * 0.165) + DVec3::Z * 0.255;
        scene.each(-3..=3, |i| side.block(merlon(i), 0.085, 0.11, 0.10), stone(false));
    }
}

/// Adds the portcullis and the drawbridge on its chains.
fn gate(scene: &mut Builder) {
    let iron = metal(0x787a82);
    let bar = |x: f64| Convex::rod(v(x, -SIDE, FLOOR + 0.06), v(x, -SIDE, FLOOR + 0.35), 0.010);
    scene.each(-2..=2, |i| bar(f64::from(i) * 0.06), iron);
    scene.each([0.12, 0.20, 0.28], |z| Convex::rod(v(-0.15, -SIDE, FLOOR + z), v(0.15, -SIDE, FLOOR + z), 0.009), iron);
    let plank = Stripes(rgb(0x8e5c30), rgb(0x603a1c), v(16.0, 0.0, 0.0));
    scene.block(v(0.0, -1.02, FLOOR + 0.02), v(0.30, 0.36, 0.03), matt(plank));
    let chain = |x: f64| Convex::rod(v(x, -1.17, FLOOR + 0.03), v(x, -SIDE - 0.05, FLOOR + 0.36), 0.008);
    scene.each([-0.14, 0.14], chain, iron);
}

/// Adds the keep: a square tower with tall windows right through it, turrets and a polished dome.
fn keep(scene: &mut Builder) {
    let foot = v(0.08, 0.12, FLOOR);
    let (half, height) = (0.30, 1.12);
    let centre = foot + DVec3::Z * (0.5 * height);
    let mut cuts = Vec::new();
    for z in [0.35, 0.78] {
        cuts.extend([DVec3::X, DVec3::Y].map(|axis| arched(foot + DVec3::Z * z, axis, 1.0, 0.16, 0.20)).concat());
    }
    let size = v(2.0 * half, 2.0 * half, height);
    scene.carved(Convex::block(centre, size), cuts, matt(Bricks(rgb(0xcea070), rgb(0x786450), 0.12, 0.06, false)));
    for (x, y) in CORNERS {
        let at = foot + v(half * x, half * y, height - 0.20);
        scene.cone(at, 0.05, 0.09, 0.10, stone(true));
        scene.cylinder(at + DVec3::Z * 0.10, 0.09, 0.22, stone(true));
        scene.cone(at + DVec3::Z * 0.32, 0.11, 0.0, 0.20, roof(0x6e3c82));
    }
    let gold = metal(0xe2b246);
    scene.sphere(foot + DVec3::Z * height, 0.23, gold);
    scene.rod(foot + DVec3::Z * (height + 0.2), foot + DVec3::Z * (height + 0.52), 0.014, gold);
    scene.sphere(foot + DVec3::Z * (height + 0.54), 0.035, gold);
}

/// Adds a well, a tree and some barrels in the yard.
fn yard(scene: &mut Builder) {
    let well = v(-0.42, -0.40, FLOOR);
    let bore = vec![Convex::cylinder(well + DVec3::Z * 0.02, 0.09, 0.3)];
    scene.carved(Convex::cylinder(well, 0.13, 0.15), bore, stone(true));
    let wood = matt(0x6e4624);
    let foot = |side: f64| well + DVec3::X * side;
    scene.each([-0.11, 0.11], |side| Convex::rod(foot(side), foot(side) + DVec3::Z * 0.34, 0.014), wood);
    scene.cone(well + DVec3::Z * 0.32, 0.19, 0.0, 0.13, roof(0x965432));
    let leaves = matt(Patches(rgb(0x78b43c), rgb(0x245c28), 16.0));
    let trunk = v(0.52, -0.42, FLOOR);
    scene.rod(trunk, trunk + DVec3::Z * 0.30, 0.028, wood);
    let crowns = [(v(0.0, 0.0, 0.40), 0.13), (v(0.08, 0.05, 0.32), 0.09), (v(-0.07, -0.05, 0.34), 0.10)];
    scene.each(crowns, |(above, radius)| Convex::sphere(trunk + above, radius), leaves);
}
