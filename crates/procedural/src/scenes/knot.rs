//! A varnished trefoil knot with a mirror ball in its heart, on a plinth pierced by windows.

use std::f64::consts::TAU;

use super::{glossy, polar, rgb, v};
use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material};
use crate::texture::Texture;

const PIECES: usize = 120;

pub(crate) fn knot() -> Builder {
    let mut scene = Builder::default();
    let trefoil = |s: f64| {
        let a = TAU * s;
        let r = 0.58 + 0.24 * (3.0 * a).cos();
        v(r * (2.0 * a).cos(), r * (2.0 * a).sin(), 0.25 + 0.36 * (3.0 * a).sin())
    };
    // (length along the tube, angle about it): eight strands of cells that twist around.
    let scales = Texture::Checker { a: rgb(214, 62, 40), b: rgb(250, 196, 66), per_unit: v(7.0, 8.0 / TAU, 1.0) };
    scene.closed_tube(trefoil, PIECES, 0.155, Material::glossy(scales));
    scene.sphere(v(0.0, 0.0, 0.25), 0.24, Material::metal(rgb(225, 230, 238)));
    scene.ring(LocalFrame::along(v(0.0, 0.0, 0.25), v(0.5, 0.3, 1.0)), 0.30, 0.018, brass());

    plinth(&mut scene);
    for i in 0..12 {
        let angle = f64::from(i) * 30.0 + 15.0;
        let colour = if i % 2 == 0 { rgb(32, 120, 190) } else { rgb(240, 240, 230) };
        let bead = glossy(colour);
        scene.sphere(polar(0.86, angle, -0.56), 0.075, bead);
    }
    scene
}

fn brass() -> Material {
    Material::metal(rgb(212, 170, 80))
}

/// Adds a marble drum with eight arched windows right through its wall, open at the top under three rods that carry the
/// knot.
fn plinth(scene: &mut Builder) {
    let marble = Texture::Marble { a: rgb(232, 228, 220), b: rgb(70, 84, 96), per_unit: 2.6 };
    let mut cuts = vec![Convex::cylinder(v(0.0, 0.0, -0.93), 0.60, 0.6)];
    for i in 0..8 {
        let (inner, outer) = (polar(0.4, f64::from(i) * 45.0, -0.79), polar(1.2, f64::from(i) * 45.0, -0.79));
        cuts.push(Convex::rod(inner, outer, 0.10));
    }
    scene.carved(Convex::cylinder(v(0.0, 0.0, -0.98), 0.95, 0.36), cuts, Material::satin(marble));
    let steps = Texture::Checker { a: rgb(40, 46, 60), b: rgb(176, 170, 150), per_unit: v(6.0, 6.0, 0.1) };
    scene.cylinder(v(0.0, 0.0, -1.10), 1.10, 0.12, Material::matt(steps));
    for i in 0..3 {
        let angle = f64::from(i) * 120.0 + 30.0;
        scene.rod(polar(0.5, angle, -1.0), polar(0.72, angle, 0.1), 0.022, brass());
        scene.rod(polar(0.5, angle, -1.0), polar(0.42, angle + 60.0, 0.1), 0.022, brass());
    }
}
