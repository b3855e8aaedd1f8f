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

pub(super) use aquarium::aquarium;
pub(super) use birdcage::birdcage;
pub(super) use bookshelf::bookshelf;
pub(super) use castle::castle;
pub(super) use chessman::chessman;
pub(super) use crane::crane;
pub(super) use facade::facade;
pub(super) use figure::figure;
pub(super) use kettle::kettle;
pub(super) use knot::knot;
pub(super) use orrery::orrery;
pub(super) use piano::piano;
pub(super) use porcelain::porcelain;
pub(super) use random::random;
pub(super) use room::room;
pub(super) use table::table;

use glam::DVec3;

use crate::model::Material;
use crate::texture::Texture;

/// Builds a point or an extent.
fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Converts display values of 0 to 255 to linear RGB.
fn rgb(r: u8, g: u8, b: u8) -> DVec3 {
    DVec3::new(f64::from(r), f64::from(g), f64::from(b)).map(|c| (c / 255.0).powf(2.2))
}

/// Returns the point `radius` away from the z axis at `degrees` from x, at height `z`.
fn polar(radius: f64, degrees: f64, z: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}

fn matt(colour: DVec3) -> Material {
    Material::matt(Texture::Plain(colour))
}

fn satin(colour: DVec3) -> Material {
    Material::satin(Texture::Plain(colour))
}

fn glossy(colour: DVec3) -> Material {
    Material::glossy(Texture::Plain(colour))
}

fn bricks(brick: DVec3, mortar: DVec3, [width, height]: [f64; 2], round: bool) -> Texture {
    Texture::Bricks { brick, mortar, width, height, round }
}

fn flowers(ground: DVec3, petal: DVec3, per_unit: f64, round: bool) -> Texture {
    Texture::Flowers { ground, petal, per_unit, round }
}

fn stripes(a: DVec3, b: DVec3, direction: DVec3) -> Texture {
    Texture::Stripes { a, b, direction }
}
