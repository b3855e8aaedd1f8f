//! A brass orrery: glossy planets on thin arms over a toothed wheel.

use glam::DVec3;

use super::{glossy, matt, polar, rgb, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

pub(crate) fn orrery() -> Builder {
    let mut scene = Builder::default();
    stand(&mut scene);
    let sun = Texture::Bands { a: rgb(252, 176, 40), b: rgb(238, 96, 24), c: rgb(255, 226, 120), per_unit: 5.0 };
    scene.sphere(v(0.0, 0.0, 0.22), 0.28, Material::glossy(sun));
    planets(&mut scene);
    armillary(&mut scene);
    scene
}

fn brass() -> Material {
    Material::metal(rgb(214, 168, 84))
}

fn copper() -> Material {
    Material::metal(rgb(196, 116, 76))
}

/// Adds a wooden foot, a toothed wheel with round holes, and the column.
fn stand(scene: &mut Builder) {
    let wood = Texture::Bands { a: rgb(126, 74, 38), b: rgb(84, 44, 22), c: rgb(150, 96, 54), per_unit: 9.0 };
    scene.cone(v(0.0, 0.0, -1.12), 0.74, 0.62, 0.14, Material::glossy(wood));
    for k in 0..6 {
        let foot = polar(0.72, f64::from(k) * 60.0, -1.12);
        scene.sphere(foot, 0.07, copper());
    }
    let wheel = v(0.0, 0.0, -0.86);
    let holes = (0..6).map(|k| Convex::cylinder(polar(0.42, f64::from(k) * 60.0 + 30.0, -1.0), 0.145, 0.3)).collect();
    let enamel = Texture::Checker { a: rgb(20, 62, 110), b: rgb(226, 220, 200), per_unit: v(7.0, 7.0, 0.1) };
    scene.carved(Convex::cylinder(wheel, 0.70, 0.07), holes, Material::glossy(enamel));
    for k in 0..30 {
        let angle = f64::from(k) * 12.0;
        let tooth = polar(0.735, angle, wheel.z + 0.035);
        scene.solid(Convex::block(tooth, v(0.09, 0.07, 0.07)).turned(angle), brass());
    }
    scene.cylinder(v(0.0, 0.0, -0.98), 0.09, 0.5, copper());
    scene.cone(v(0.0, 0.0, -0.48), 0.09, 0.03, 0.20, brass());
    scene.rod(v(0.0, 0.0, -0.4), v(0.0, 0.0, 0.0), 0.03, brass());
    for (z, radius) in [(-0.72, 0.13), (-0.60, 0.115), (-0.48, 0.11)] {
        scene.ring(LocalFrame::at(v(0.0, 0.0, z)), radius, 0.022, brass());
    }
}

/// Adds an arm from the column to under a planet at `at`, and the pin that carries it.
fn arm(scene: &mut Builder, height: f64, at: DVec3) {
    let elbow = v(at.x, at.y, height);
    scene.rod(v(0.0, 0.0, height), elbow, 0.016, brass());
    scene.sphere(elbow, 0.028, copper());
    scene.rod(elbow, at, 0.012, brass());
}

fn planets(scene: &mut Builder) {
    let ocean = polar(0.72, -35.0, 0.20);
    arm(scene, -0.30, ocean);
    let earth = Texture::Patches { a: rgb(70, 140, 60), b: rgb(24, 78, 170), per_unit: 8.0, cap: 0.92 };
    scene.sphere(ocean, 0.15, Material::glossy(earth));
    let moon = ocean + v(0.16, -0.14, 0.12);
    scene.rod(ocean, moon, 0.008, brass());
    scene.sphere(
        moon,
        0.05,
        Material::matt(Texture::Patches { a: rgb(200, 200, 196), b: rgb(140, 140, 138), per_unit: 30.0, cap: 9.0 }),
    );

    let giant = polar(0.80, 100.0, 0.02);
    arm(scene, -0.22, giant);
    let bands = Texture::Bands { a: rgb(222, 186, 140), b: rgb(168, 104, 66), c: rgb(246, 232, 206), per_unit: 9.0 };
    scene.sphere(giant, 0.22, Material::glossy(bands));

    let ringed = polar(0.84, 205.0, 0.24);
    arm(scene, -0.36, ringed);
    let tilt = v(0.35, -0.2, 1.0).normalize();
    let stripes =
        Texture::Bands { a: rgb(230, 208, 150), b: rgb(190, 160, 100), c: rgb(244, 234, 200), per_unit: 12.0 };
    scene.sphere(ringed, 0.15, Material::glossy(stripes));
    for (inner, outer, colour) in [(0.19, 0.235, rgb(206, 184, 150)), (0.25, 0.285, rgb(150, 130, 110))] {
        let half = tilt * 0.006;
        let cut = vec![Convex::rod(ringed - tilt * 0.1, ringed + tilt * 0.1, inner)];
        scene.carved(Convex::rod(ringed - half, ringed + half, outer), cut, matt(colour));
    }

    let red = polar(0.52, 30.0, 0.42);
    arm(scene, -0.14, red);
    let rust = Texture::Patches { a: rgb(216, 110, 62), b: rgb(146, 58, 34), per_unit: 11.0, cap: 0.98 };
    scene.sphere(red, 0.10, Material::glossy(rust));

    let mirror = polar(0.46, 265.0, 0.12);
    arm(scene, -0.08, mirror);
    scene.sphere(mirror, 0.085, Material::metal(rgb(228, 232, 240)));
}

/// Adds two great hoops about everything, with beads.
fn armillary(scene: &mut Builder) {
    let centre = v(0.0, 0.0, 0.10);
    scene.ring(LocalFrame::along(centre, v(0.3, 1.0, 0.12)), 1.04, 0.020, brass());
    scene.ring(LocalFrame::along(centre, v(1.0, -0.25, 0.35)), 0.98, 0.016, copper());
    let enamel = glossy(rgb(190, 30, 50));
    let frame = LocalFrame::along(centre, v(0.3, 1.0, 0.12));
    for k in 0..8 {
        let bead = centre + frame.rotation * polar(1.04, f64::from(k) * 45.0, 0.0);
        scene.sphere(bead, 0.045, enamel);
    }
}
