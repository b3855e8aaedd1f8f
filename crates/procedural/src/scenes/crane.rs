//! A tower crane: lattices of thin rods over a brick base.

use super::*;

/// Radius of the main members and of the braces.
const MEMBER: f64 = 0.020;
const BRACE: f64 = 0.012;

pub(super) fn crane(scene: &mut Builder) {
    base(scene);
    let yellow = glossy(0xf2b21c);
    mast(scene, yellow);
    jib(scene, yellow);
    cabin(scene);
    load(scene);
}

/// Adds a brick block with a vaulted passage each way, crates and barrels around it.
fn base(scene: &mut Builder) {
    let brick = Bricks(rgb(0xb04a34), rgb(0xd6cebe), 0.16, 0.075, false);
    let centre = v(-0.25, 0.0, -0.93);
    let cuts = [DVec3::X, DVec3::Y].map(|axis| arched(centre - DVec3::Z * 0.13, axis, 2.0, 0.36, 0.24)).concat();
    scene.carved(Convex::block(centre, v(0.8, 0.8, 0.5)), cuts, matt(brick));
    scene.block(v(0.05, 0.0, -1.14), v(2.1, 1.3, 0.08), matt(Checker(rgb(0x787c80), rgb(0xb0b2b4), v(5.0, 5.0, 0.1))));

    let plank = Stripes(rgb(0x966030), rgb(0x6c401e), v(0.0, 0.0, 14.0));
    scene.solid(Convex::block(v(0.62, -0.35, -0.96), v(0.28, 0.28, 0.28)).turned(20.0), matt(plank));
    scene.solid(Convex::block(v(0.62, -0.33, -0.73), v(0.18, 0.18, 0.18)).turned(50.0), matt(plank));
    for (place, colour) in [(v(0.75, 0.30, -1.10), rgb(0x1e60aa)), (v(0.45, 0.42, -1.10), rgb(0x288c50))] {
        scene.cylinder(place, 0.115, 0.30, glossy(Stripes(colour, rgb(0xe2e2e2), v(0.0, 0.0, 7.0))));
    }
}

/// Adds a square lattice mast on the block.
fn mast(scene: &mut Builder, paint: Material) {
    let (low, high, half, bays) = (-0.68, 0.62, 0.13, 6);
    let corner = |k: usize, z: f64| {
        let (x, y) = CORNERS[k % 4];
        v(-0.25 + half * x, half * y, z)
    };
    scene.each(0..4, |k| Convex::rod(corner(k, low), corner(k, high), MEMBER), paint);
    let step = (high - low) / f64::from(bays);
    for bay in 0..bays {
        let (z, top) = (low + step * f64::from(bay), low + step * f64::from(bay + 1));
        for k in 0..4 {
            let (from, to) = if bay % 2 == 0 { (k, k + 1) } else { (k + 1, k) };
            scene.rod(corner(from, z), corner(to, top), BRACE, paint);
            scene.rod(corner(k, top), corner(k + 1, top), BRACE, paint);
        }
    }
}

/// Adds a triangular lattice jib with its counterweight, stayed from a peak.
fn jib(scene: &mut Builder, paint: Material) {
    let (back, tip, z) = (-1.02, 1.12, 0.66);
    let lower = |x: f64, side: f64| v(x, side * 0.10, z);
    let upper = |x: f64| v(x, 0.0, z + 0.17);
    scene.each([-1.0, 1.0], |side| Convex::rod(lower(back, side), lower(tip, side), MEMBER), paint);
    scene.rod(upper(-0.3), upper(tip - 0.08), MEMBER, paint);
    let bays = 9;
    let step = (tip - 0.08 + 0.2) / f64::from(bays);
    for bay in 0..bays {
        let x = -0.2 + step * f64::from(bay);
        let middle = (x + 0.5 * step).min(tip - 0.08);
        for side in [-1.0, 1.0] {
            scene.rod(lower(x, side), upper(middle), BRACE, paint);
            scene.rod(upper(middle), lower(x + step, side), BRACE, paint);
        }
        scene.rod(lower(x, -1.0), lower(x, 1.0), BRACE, paint);
    }
    let steel = metal(0xaab0b8);
    let peak = v(-0.25, 0.0, 1.13);
    for side in [-1.0, 1.0] {
        scene.rod(v(-0.25, side * 0.10, z), peak, MEMBER, paint);
        scene.rod(peak, lower(back + 0.08, side), 0.009, steel);
    }
    scene.each([0.85, 0.40], |x| Convex::rod(peak, upper(x), 0.009), steel);
    let warning = Stripes(rgb(0xecbe14), rgb(0x18181a), v(4.5, 0.0, 4.5));
    scene.block(v(-0.90, 0.0, 0.56), v(0.26, 0.26, 0.26), glossy(warning));
}

/// Adds the driver's cabin, with windows cut out, next to the mast.
fn cabin(scene: &mut Builder) {
    let centre = v(-0.03, -0.21, 0.47);
    let cuts = vec![
        Convex::block(centre + v(0.0, 0.0, 0.03), v(0.20, 0.5, 0.12)),
        Convex::block(centre + v(0.1, 0.0, 0.03), v(0.3, 0.17, 0.12)),
    ];
    scene.carved(Convex::block(centre, v(0.28, 0.24, 0.27)), cuts, glossy(0xc82420));
    scene.sphere(centre - DVec3::Z * 0.02, 0.07, matt(0x1e3c6e));
}

/// Adds a polished ball with a ring, hung from the trolley.
fn load(scene: &mut Builder) {
    let steel = metal(0xbec4cc);
    let x = 0.72;
    scene.block(v(x, 0.0, 0.62), v(0.16, 0.24, 0.06), matt(0x32343a));
    scene.each([-0.04, 0.04], |side| Convex::rod(v(x, side, 0.62), v(x, side * 0.3, 0.06), 0.008), steel);
    scene.ring(LocalFrame::along(v(x, 0.0, 0.0), DVec3::X), 0.06, 0.016, steel);
    scene.sphere(v(x, 0.0, -0.27), 0.21, glossy(Globe(rgb(0x3c823c), rgb(0x1c54a8), 7.0, 0.95)));
}
