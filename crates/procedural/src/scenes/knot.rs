//! A varnished trefoil knot with a mirror ball in its heart, on a plinth pierced by windows.

use std::f64::consts::TAU;

use super::*;

const PIECES: usize = 120;
const BRASS: u32 = 0xd4aa50;

pub(super) fn knot(scene: &mut Builder) {
    let trefoil = |s: f64| {
        let a = TAU * s;
        let r = 0.58 + 0.24 * (3.0 * a).cos();
        v(r * (2.0 * a).cos(), r * (2.0 * a).sin(), 0.25 + 0.36 * (3.0 * a).sin())
    };
    // (length along the tube, angle about it): eight strands of cells that twist around.
    scene.tube(trefoil, PIECES, 0.155, glossy(Checker(rgb(0xd63e28), rgb(0xfac442), v(7.0, 8.0 / TAU, 1.0))));
    scene.sphere(v(0.0, 0.0, 0.25), 0.24, metal(0xe1e6ee));
    scene.ring(LocalFrame::along(v(0.0, 0.0, 0.25), v(0.5, 0.3, 1.0)), 0.30, 0.018, metal(BRASS));

    plinth(scene);
    for (angle, colour) in around(12).zip([0x2078be, 0xf0f0e6].into_iter().cycle()) {
        scene.sphere(polar(0.86, angle + 15.0, -0.56), 0.075, glossy(colour));
    }
}

/// Adds a marble drum with eight arched windows through its wall, open at the top under the rods that carry the knot.
fn plinth(scene: &mut Builder) {
    let marble = Marble(rgb(0xe8e4dc), rgb(0x465460), 2.6);
    let mut cuts = vec![Convex::cylinder(v(0.0, 0.0, -0.93), 0.60, 0.6)];
    let window = |degrees: f64| Convex::rod(polar(0.4, degrees, -0.79), polar(1.2, degrees, -0.79), 0.10);
    cuts.extend(around(8).map(window));
    scene.carved(Convex::cylinder(v(0.0, 0.0, -0.98), 0.95, 0.36), cuts, satin(marble));
    scene.cylinder(v(0.0, 0.0, -1.10), 1.10, 0.12, matt(Checker(rgb(0x282e3c), rgb(0xb0aa96), v(6.0, 6.0, 0.1))));
    for angle in around(3) {
        let foot = polar(0.5, angle + 30.0, -1.0);
        scene.rod(foot, polar(0.72, angle + 30.0, 0.1), 0.022, metal(BRASS));
        scene.rod(foot, polar(0.42, angle + 90.0, 0.1), 0.022, metal(BRASS));
    }
}
