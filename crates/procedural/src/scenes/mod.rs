//! The scenes, one file each.

mod aquarium;
mod birdcage;
mod bookshelf;
mod castle;
mod chessman;
mod crane;
mod facade;
mod figure;
mod kettle;
mod knot;
mod orrery;
mod piano;
mod porcelain;
mod random;
mod room;
mod table;

pub(super) use random::random;

use glam::DVec3;

use crate::convex::{Convex, LocalFrame};
use crate::model::{Builder, Material, glass, glossy, matt, metal, mirror, satin};
use crate::texture::Texture::{
    self, Bands, Bricks, Checker, Flowers, Marble, Patches, Plain, Planks, Shingles, Stripes,
};
use crate::texture::rgb;

/// Name of a scene, function that adds its objects, scale, and rise.
type BuiltInScene = (&'static str, fn(&mut Builder), f64, f64);

/// Scenes that were built by hand. Scale and rise were chosen so that no camera's image is cropped.
pub(super) const SCENES: [BuiltInScene; 15] = [
    ("castle", castle::castle, 0.87, 0.18),
    ("crane", crane::crane, 0.81, 0.15),
    ("knot", knot::knot, 0.90, 0.17),
    ("orrery", orrery::orrery, 0.94, 0.08),
    ("aquarium", aquarium::aquarium, 0.90, 0.12),
    ("birdcage", birdcage::birdcage, 1.00, 0.00),
    ("bookshelf", bookshelf::bookshelf, 0.88, -0.10),
    ("chessman", chessman::chessman, 1.00, 0.00),
    ("facade", facade::facade, 1.00, 0.00),
    ("kettle", kettle::kettle, 1.00, 0.10),
    ("piano", piano::piano, 0.92, 0.12),
    ("porcelain", porcelain::porcelain, 0.92, 0.08),
    ("room", room::room, 1.00, 0.00),
    ("table", table::table, 1.00, 0.00),
    ("figure", figure::figure, 1.00, 0.00),
];

/// Builds a point or an extent.
fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Returns the point `radius` away from the z axis at `degrees` from x, at height `z`.
fn polar(radius: f64, degrees: f64, z: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}
