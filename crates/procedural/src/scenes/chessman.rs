//! A chess queen, alone and small in the image.

use super::*;

pub(super) fn chessman(scene: &mut Builder) {
    let foot = v(0.10, -0.08, -0.42);
    let at = |z: f64| foot + v(0.0, 0.0, z);
    let wood = Bands(rgb(0xbe5428), rgb(0x782814), rgb(0xe28c46), 11.0);
    let gold = metal(0xe8ba54);
    scene.cylinder(at(-0.01), 0.165, 0.02, matt(0x145432));
    let body = [
        0.165, 0.01, 0.175, 0.035, 0.165, 0.07, 0.13, 0.09, 0.135, 0.115, 0.105, 0.15, 0.065, 0.24, 0.05, 0.36, 0.055,
        0.46, 0.10, 0.485, 0.10, 0.505, 0.06, 0.525, 0.065, 0.56, 0.10, 0.66,
    ];
    scene.lathe(foot, &body, glossy(wood));
    scene.rings([(0.08, 0.145), (0.50, 0.098)].map(|(z, radius)| (at(z), radius, 0.013)), gold);
    for (angle, colour) in around(8).zip([0xf0eee6, 0x285aaa].into_iter().cycle()) {
        scene.sphere(foot + polar(0.092, angle, 0.675), 0.024, glossy(colour));
    }
    scene.lathe(foot, &[0.085, 0.65, 0.075, 0.69, 0.03, 0.72, 0.004, 0.725], glossy(wood));
    scene.sphere(at(0.745), 0.036, gold);
}
