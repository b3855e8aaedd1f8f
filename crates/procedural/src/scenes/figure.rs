//! A dancer: an articulated figure of rods with round joints.

use super::*;

pub(super) fn figure(scene: &mut Builder) {
    let skin = satin(0xdea480);
    let jersey = matt(Stripes(rgb(0xce2c32), rgb(0xf6f0e6), v(0.0, 0.0, 11.0)));
    let sleeve = matt(0xc4282e);
    let jeans = matt(Checker(rgb(0x284278), rgb(0x304e88), v(22.0, 22.0, 22.0)));
    let shoe = glossy(0xf0ece2);
    let hair = satin(Stripes(rgb(0x462814), rgb(0x2e180c), v(22.0, 0.0, 6.0)));
    let ink = glossy(0x181416);

    // Standing on the left leg, the right one bent; the left arm up, the right one to the side. It faces −y.
    let hip = v(0.0, 0.0, -0.08);
    let neck = v(0.03, -0.02, 0.50);
    let trunk = LocalFrame::along(hip, neck - hip);
    scene.lathe(trunk, &[0.02, -0.12, 0.13, -0.07, 0.155, 0.0, 0.15, 0.07], jeans);
    scene.lathe(trunk, &[0.155, 0.05, 0.14, 0.18, 0.17, 0.38, 0.165, 0.48, 0.08, 0.57, 0.055, 0.60], jersey);
    scene.ring(LocalFrame { origin: hip + trunk.rotation.z_axis * 0.06, ..trunk }, 0.15, 0.018, ink);
    limb(scene, neck, v(0.04, -0.03, 0.66), 0.058, 0.055, skin);
    let head = v(0.05, -0.05, 0.80);
    let outline = [0.02, -0.165, 0.075, -0.13, 0.115, -0.03, 0.12, 0.05, 0.08, 0.13, 0.01, 0.16];
    scene.lathe(LocalFrame::along(head, v(0.06, -0.08, 1.0)), &outline, skin);
    scene.sphere(head + v(0.005, 0.022, 0.065), 0.126, hair);
    scene.sphere(head + v(0.02, 0.14, 0.12), 0.07, hair);
    scene.each([-0.045, 0.045], |x| Convex::sphere(head + v(x, -0.105, 0.0), 0.019), ink);
    scene.solid(Convex::taper(head + v(0.0, -0.11, -0.02), head + v(0.0, -0.15, -0.045), 0.012, 0.02), skin);
    scene.rod(head + v(-0.03, -0.098, -0.085), head + v(0.03, -0.098, -0.085), 0.012, satin(0xbe4646));

    for (shoulder, elbow, hand) in [
        (v(0.17, -0.01, 0.44), v(0.40, -0.06, 0.60), v(0.42, -0.16, 0.88)),
        (v(-0.14, -0.01, 0.43), v(-0.40, -0.12, 0.28), v(-0.64, -0.26, 0.34)),
    ] {
        limb(scene, shoulder, elbow, 0.075, 0.058, sleeve);
        limb(scene, elbow, hand, 0.050, 0.038, skin);
        scene.sphere(hand, 0.052, skin);
        let ahead = (hand - elbow).normalize_or(DVec3::Z);
        for k in -1..=1 {
            let spread = ahead.cross(DVec3::Y).normalize_or(DVec3::X) * (0.028 * f64::from(k));
            limb(scene, hand + spread, hand + ahead * 0.10 + spread * 1.6, 0.018, 0.014, skin);
        }
    }
    for (top, knee, ankle, toe) in [
        (v(0.085, 0.0, -0.12), v(0.12, -0.04, -0.56), v(0.10, 0.03, -1.02), v(0.13, -0.14, -1.08)),
        (v(-0.085, 0.0, -0.12), v(-0.28, -0.30, -0.42), v(-0.34, 0.02, -0.74), v(-0.37, -0.12, -0.84)),
    ] {
        limb(scene, top, knee, 0.105, 0.078, jeans);
        limb(scene, knee, ankle, 0.074, 0.052, jeans);
        limb(scene, ankle - DVec3::Z * 0.04, toe, 0.056, 0.048, shoe);
    }
    scene.cylinder(v(0.0, 0.0, -1.20), 0.50, 0.06, satin(Checker(rgb(0x3c404c), rgb(0x545a68), v(8.0, 8.0, 0.1))));
}

/// Adds a tapered rod with balls at its ends.
fn limb(scene: &mut Builder, a: DVec3, b: DVec3, from: f64, to: f64, material: Material) {
    scene.solid(Convex::taper(a, b, from, to), material);
    scene.sphere(a, from, material);
    scene.sphere(b, to, material);
}
