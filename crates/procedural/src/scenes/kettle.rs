//! A polished kettle with a copper pot and tins on a chequered tray: mirror images that move with the view.

use std::f64::consts::PI;

use super::*;

const TOP: f64 = -0.72;
const STEEL: u32 = 0xe2e6ec;
const GOLD: u32 = 0xe8ba54;

pub(super) fn kettle(scene: &mut Builder) {
    tray(scene);
    body(scene);
    company(scene);
}

fn tray(scene: &mut Builder) {
    let tiles = Checker(rgb(0xb02228), rgb(0xf0e8d6), v(6.5, 6.5, 0.1));
    scene.cylinder(v(0.0, 0.0, TOP - 0.09), 1.08, 0.09, glossy(tiles));
    scene.ring(v(0.0, 0.0, TOP - 0.02), 1.08, 0.04, mirror(GOLD));
    scene.each(around(5), |angle| Convex::sphere(polar(0.9, angle, TOP - 0.13), 0.06), mirror(GOLD));
}

fn body(scene: &mut Builder) {
    let foot = v(-0.08, 0.0, TOP);
    let at = |x: f64, z: f64| foot + v(x, 0.0, z);
    scene.lathe(foot, &[0.44, 0.0, 0.47, 0.03, 0.46, 0.06], metal(0x28282c));
    let belly = [0.46, 0.06, 0.56, 0.14, 0.61, 0.28, 0.58, 0.46, 0.47, 0.66, 0.33, 0.82, 0.27, 0.88, 0.26, 0.92];
    scene.lathe(foot, &belly, mirror(STEEL));
    scene.ring(at(0.0, 0.92), 0.26, 0.022, mirror(GOLD));
    scene.lathe(foot, &[0.245, 0.92, 0.22, 0.98, 0.13, 1.03, 0.04, 1.05], mirror(STEEL));
    scene.lathe(foot, &[0.03, 1.04, 0.035, 1.08, 0.075, 1.13, 0.07, 1.18, 0.01, 1.205], glossy(0x181618));
    // The spout rises towards +x.
    let spout = LocalFrame::along(at(0.42, 0.30), v(1.0, 0.0, 0.78));
    scene.lathe(spout, &[0.19, 0.0, 0.14, 0.14, 0.10, 0.30, 0.085, 0.44, 0.10, 0.52], mirror(STEEL));
    scene.ring(LocalFrame { origin: spout.origin + spout.rotation.z_axis * 0.52, ..spout }, 0.088, 0.016, mirror(GOLD));
    let dark = matt(0x0e0e10);
    scene.rod(spout.origin + spout.rotation.z_axis * 0.5, spout.origin + spout.rotation.z_axis * 0.524, 0.08, dark);
    // The handle arches over the lid.
    let arch = |s: f64| {
        let a = PI * s;
        at(0.47 * a.cos(), 0.64 + 0.72 * a.sin())
    };
    scene.tube(arch, 30, 0.028, mirror(STEEL));
    let grip = |s: f64| arch(0.30 + 0.40 * s);
    scene.tube(grip, 16, 0.048, glossy(Stripes(rgb(0x783c1e), rgb(0x462012), v(20.0, 0.0, 0.0))));
    scene.each([0.0, 0.30, 0.70, 1.0], |s| Convex::sphere(arch(s), 0.062), mirror(GOLD));
    let band = Stripes(rgb(0xe8be5a), rgb(0x96641e), v(0.0, 12.0, 0.0));
    scene.ring(at(0.0, 0.30), 0.605, 0.014, Material { texture: band, ..mirror(GOLD) });
}

/// Adds a milk can of copper, a sphere, a cup and a lemon.
fn company(scene: &mut Builder) {
    let copper = mirror(0xd6784e);
    let can = v(0.52, 0.58, TOP);
    scene.lathe(can, &[0.15, 0.0, 0.19, 0.08, 0.18, 0.20, 0.12, 0.32, 0.11, 0.38, 0.15, 0.46], copper);
    scene.ring(can + DVec3::Z * 0.46, 0.145, 0.012, copper);
    scene.cylinder(can + DVec3::Z * 0.44, 0.14, 0.015, matt(0xf6f0e2));
    scene.ring(LocalFrame::along(can + v(0.17, 0.05, 0.24), v(-0.3, 1.0, 0.0)), 0.10, 0.018, copper);
    scene.sphere(v(0.58, -0.50, TOP + 0.17), 0.17, mirror(STEEL));
    let along = LocalFrame::along(v(0.20, -0.74, TOP + 0.10), v(1.0, 0.5, 0.1));
    let outline = [0.01, -0.17, 0.03, -0.14, 0.085, -0.08, 0.10, 0.0, 0.085, 0.08, 0.03, 0.14, 0.01, 0.16];
    scene.lathe(along, &outline, glossy(0xfad028));
    scene.solid(Convex::block(v(0.36, -0.62, TOP + 0.13), v(0.14, 0.07, 0.012)).turned(40.0), glossy(0x328232));
    let mug = v(-0.62, 0.52, TOP);
    let blue = Flowers(rgb(0x224696), rgb(0xf6f0dc), 11.0, true);
    let hollow = vec![Convex::cylinder(mug + DVec3::Z * 0.05, 0.125, 0.5)];
    scene.carved(Convex::cylinder(mug, 0.145, 0.30), hollow, glossy(blue));
    scene.ring(LocalFrame::along(mug + v(-0.16, 0.03, 0.15), v(0.2, 1.0, 0.0)), 0.085, 0.02, glossy(0x224696));
    scene.cylinder(mug + DVec3::Z * 0.2, 0.125, 0.02, glossy(0x602e12));
    for (angle, colour) in [(215.0, rgb(0x3c965a)), (245.0, rgb(0xe27828))] {
        let jar = polar(0.82, angle, TOP);
        scene.lathe(jar, &[0.10, 0.0, 0.12, 0.04, 0.12, 0.16, 0.09, 0.21], metal(colour));
        scene.lathe(jar, &[0.10, 0.205, 0.10, 0.235, 0.05, 0.26, 0.005, 0.268], mirror(GOLD));
    }
}
