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
    self, Bands, Bricks, Checker, Flowers, Globe, Marble, Patches, Plain, Planks, Shingles, Stripes,
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

/// Corners of the square that reaches from −1 to 1 along x and y, counter-clockwise.
const CORNERS: [(f64, f64); 4] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];

/// Returns `count` angles at equal distances around a circle, degrees from 0 on.
fn around(count: u32) -> impl Iterator<Item = f64> {
    (0..count).map(move |k| 360.0 * f64::from(k) / f64::from(count))
}

/// Returns the parts of an arched opening along `axis`, x or y: a block of this size about `middle`, and a cylinder of the same
/// width about the middle of its upper side.
fn arched(middle: DVec3, axis: DVec3, length: f64, width: f64, height: f64) -> [Convex; 2] {
    let size = axis * length + (DVec3::ONE - axis - DVec3::Z) * width + DVec3::Z * height;
    let (crown, half) = (middle + DVec3::Z * (0.5 * height), axis * (0.5 * length));
    [Convex::block(middle, size), Convex::rod(crown - half, crown + half, 0.5 * width)]
}

/// Upright side of an object that is turned about the vertical axis. The side faces −y if the object is not turned.
#[derive(Clone, Copy)]
struct Side {
    /// Angle of the turn, degrees.
    turn: f64,
    /// Direction along the side, to the right as seen from outside.
    along: DVec3,
    /// Direction in which the side faces.
    out: DVec3,
}

impl Side {
    fn turned(turn: f64) -> Self {
        Self { turn, along: polar(1.0, turn, 0.0), out: polar(1.0, turn - 90.0, 0.0) }
    }

    /// Returns a block that is `wide` along the side and `deep` across it.
    fn block(self, centre: DVec3, wide: f64, deep: f64, high: f64) -> Convex {
        Convex::block(centre, v(wide, deep, high)).turned(self.turn)
    }
}

/// Builds a point or an extent.
fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Returns the point `radius` away from the z axis at `degrees` from x, at height `z`.
fn polar(radius: f64, degrees: f64, z: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}
