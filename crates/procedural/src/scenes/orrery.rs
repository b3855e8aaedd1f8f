//! A brass orrery: glossy planets on thin arms over a toothed wheel.

use super::*;

const BRASS: u32 = 0xd6a854;
const COPPER: u32 = 0xc4744c;

pub(super) fn orrery(scene: &mut Builder) {
    stand(scene);
    scene.sphere(v(0.0, 0.0, 0.22), 0.28, glossy(Bands(rgb(0xfcb028), rgb(0xee6018), rgb(0xffe278), 5.0)));
    planets(scene);
    armillary(scene);
}

/// Adds a wooden foot, a toothed wheel with round holes, and the column.
fn stand(scene: &mut Builder) {
    scene.cone(v(0.0, 0.0, -1.12), 0.74, 0.62, 0.14, glossy(Bands(rgb(0x7e4a26), rgb(0x542c16), rgb(0x966036), 9.0)));
    scene.each(around(6), |angle| Convex::sphere(polar(0.72, angle, -1.12), 0.07), metal(COPPER));
    let wheel = v(0.0, 0.0, -0.86);
    let holes = around(6).map(|angle| Convex::cylinder(polar(0.42, angle + 30.0, -1.0), 0.145, 0.3)).collect();
    let enamel = Checker(rgb(0x143e6e), rgb(0xe2dcc8), v(7.0, 7.0, 0.1));
    scene.carved(Convex::cylinder(wheel, 0.70, 0.07), holes, glossy(enamel));
    let tooth = |angle: f64| Convex::block(polar(0.735, angle, wheel.z + 0.035), v(0.09, 0.07, 0.07)).turned(angle);
    scene.each(around(30), tooth, metal(BRASS));
    scene.cylinder(v(0.0, 0.0, -0.98), 0.09, 0.5, metal(COPPER));
    scene.cone(v(0.0, 0.0, -0.48), 0.09, 0.03, 0.20, metal(BRASS));
    scene.rod(v(0.0, 0.0, -0.4), v(0.0, 0.0, 0.0), 0.03, metal(BRASS));
    let rings = [(-0.72, 0.13), (-0.60, 0.115), (-0.48, 0.11)].map(|(z, radius)| (v(0.0, 0.0, z), radius, 0.022));
    scene.rings(rings, metal(BRASS));
}

/// Adds an arm from the column to under a planet at `at`, and the pin that carries it.
fn arm(scene: &mut Builder, height: f64, at: DVec3) {
    let elbow = v(at.x, at.y, height);
    scene.rod(v(0.0, 0.0, height), elbow, 0.016, metal(BRASS));
    scene.sphere(elbow, 0.028, metal(COPPER));
    scene.rod(elbow, at, 0.012, metal(BRASS));
}

fn planets(scene: &mut Builder) {
    let (ocean, ringed) = (polar(0.72, -35.0, 0.20), polar(0.84, 205.0, 0.24));
    for (height, at, radius, material) in [
        (-0.30, ocean, 0.15, glossy(Globe(rgb(0x468c3c), rgb(0x184eaa), 8.0, 0.92))),
        (-0.22, polar(0.80, 100.0, 0.02), 0.22, glossy(Bands(rgb(0xdeba8c), rgb(0xa86842), rgb(0xf6e8ce), 9.0))),
        (-0.36, ringed, 0.15, glossy(Bands(rgb(0xe6d096), rgb(0xbea064), rgb(0xf4eac8), 12.0))),
        (-0.14, polar(0.52, 30.0, 0.42), 0.10, glossy(Globe(rgb(0xd86e3e), rgb(0x923a22), 11.0, 0.98))),
        (-0.08, polar(0.46, 265.0, 0.12), 0.085, metal(0xe4e8f0)),
    ] {
        arm(scene, height, at);
        scene.sphere(at, radius, material);
    }
    let moon = ocean + v(0.16, -0.14, 0.12);
    scene.rod(ocean, moon, 0.008, metal(BRASS));
    scene.sphere(moon, 0.05, matt(Patches(rgb(0xc8c8c4), rgb(0x8c8c8a), 30.0)));
    let tilt = v(0.35, -0.2, 1.0).normalize();
    for (inner, outer, colour) in [(0.19, 0.235, rgb(0xceb896)), (0.25, 0.285, rgb(0x96826e))] {
        let half = tilt * 0.006;
        let cut = vec![Convex::rod(ringed - tilt * 0.1, ringed + tilt * 0.1, inner)];
        scene.carved(Convex::rod(ringed - half, ringed + half, outer), cut, matt(colour));
    }
}

/// Adds two great hoops about everything, with beads.
fn armillary(scene: &mut Builder) {
    let centre = v(0.0, 0.0, 0.10);
    let hoop = LocalFrame::along(centre, v(0.3, 1.0, 0.12));
    scene.ring(hoop, 1.04, 0.020, metal(BRASS));
    scene.ring(LocalFrame::along(centre, v(1.0, -0.25, 0.35)), 0.98, 0.016, metal(COPPER));
    let bead = |degrees: f64| Convex::sphere(centre + hoop.rotation * polar(1.04, degrees, 0.0), 0.045);
    scene.each(around(8), bead, glossy(0xbe1e32));
}
