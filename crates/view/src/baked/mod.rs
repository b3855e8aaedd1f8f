//! Baking to bricks of voxels, for fields that a browser cannot evaluate.
//!
//! ```text
//! field ─► coarse densities ─► bricks that are not empty ─► densities ─► colours where they are seen ─► bytes
//! ```
//!
//! - **Region** ([`domain`], [`lattice`]): cubic voxels over the box that contains the field, in the field's space. A brick is
//!   8³ voxels with the 9³ points at their corners, so that a graphics card interpolates within it; bricks share border points.
//! - **Density** ([`bricks`]): √(opacity of a voxel) in 8 bits.
//! - **Colour** ([`colors`]): `a + b·d` along the direction d, spherical harmonics of degree 1: four numbers of 8 bits for each of
//!   red, green and blue, fitted to the field's colours along directions from which the cameras look.
//! - **A field of volumes** (mip-NeRF) is evaluated over the footprint of a pixel of the nearest training camera, or over
//!   a voxel if that is larger.
//! - **The march** takes half a voxel at a time, so images differ from the program's also by their sampling: the program's
//!   own samples may be farther apart.

mod bricks;
mod colors;
#[cfg(test)]
mod decode;
mod domain;
mod lattice;
mod probe;
mod seen;

use std::fmt::Write;

use anyhow::Result;
use glam::Vec3;
use infonerf_field::{FieldConfig, FieldSpec};
use serde_json::{Value, json};

use crate::blob::{Blob, bits};
use crate::package::Subjects;
use crate::shader::{FieldMarch, integers3};
use bricks::Bricks;
use colors::{Colors, MAX_COLOR};
use domain::Domain;
use lattice::{CELLS, POINTS};
use probe::FieldProbe;

const FIELD: &str = include_str!("../../assets/bricks.glsl");
const CHANNELS: [&str; 3] = ["red", "green", "blue"];
/// Number of voxels along the longest side of a field's box: by default, of a slow field, and the maximum during training.
const RESOLUTION: usize = 256;
const SLOW_RESOLUTION: usize = 128;
const LIVE_RESOLUTION: usize = 96;
/// Number of values per sample above which a field is slow: an MLP with eight layers of 256 is slow, one with four is not.
const SLOW: u64 = 1024;
/// Minimum of the transmittance at which rays end: less light is invisible in 8 bits.
const STOP: f32 = 1e-3;

/// Returns the default number of voxels along the longest side of a field's box.
pub(crate) fn resolution(field: &FieldConfig) -> usize {
    if field.footprint().per_sample > SLOW { SLOW_RESOLUTION } else { RESOLUTION }
}

/// Returns the number of voxels along the longest side while the field trains and is baked repeatedly.
pub(crate) fn live_resolution(field: &FieldConfig) -> usize {
    (resolution(field) / 2).min(LIVE_RESOLUTION)
}

/// Makes the shader and the arrays of a field of any kind, at `resolution` or as fine as [`bricks::MAX_BRICKS`] allows.
pub(crate) fn package(subjects: &Subjects<'_>, resolution: usize) -> Result<Value> {
    let Subjects { scene, renderer, config, .. } = subjects;
    let warp = renderer.warp();
    let domain = Domain::of(scene, config, warp);
    let probe = FieldProbe::new(subjects);
    let (resolution, bricks) = Bricks::find(&probe, &domain, resolution);
    let lattice = &bricks.lattice;
    let colors = Colors::of(&probe, lattice, &seen::points(&bricks));
    let march = FieldMarch {
        scene,
        config,
        warp,
        clip: warp.is_identity().then_some(domain.bounds),
        low: lattice.low,
        cell: Vec3::splat(lattice.voxel * CELLS as f32),
        cells: lattice.cells,
        step: 0.5 * lattice.voxel,
        stop: config.early_stop_transmittance.max(STOP),
        // Over less than two voxels, differences are dominated by the rounding to bytes.
        detail: 2.0 * lattice.voxel,
    };
    let atlas = atlas(bricks.cells.len());
    let mut occupied = vec![false; lattice.cell_count()];
    bricks.cells.iter().for_each(|&cell| occupied[cell] = true);
    let mut blob = Blob::default();
    blob.add("occupied", &bits(&occupied));
    blob.add("opacities", &differences(&bricks.roots));
    for (channel, name) in CHANNELS.iter().enumerate() {
        blob.add(&format!("{name}s"), &differences(&colors.planes(channel, &bricks)));
    }
    Ok(json!({
        "shader": march.shader(&FIELD.replace("{{constants}}\n", &constants(lattice.voxel, atlas, &colors))),
        "voxels": resolution,
        "grid": lattice.cells,
        "atlas": atlas,
        "closed": true,
        "parts": blob.parts,
        "data": blob.deflated()?,
    }))
}

/// Returns the number of bricks in the textures along x, y and z: about a cube.
fn atlas(bricks: usize) -> [usize; 3] {
    let side = (1..).find(|side: &usize| side.pow(3) >= bricks).unwrap_or(1);
    [side, side, bricks.div_ceil(side * side).max(1)]
}

fn constants(voxel: f32, atlas: [usize; 3], colors: &Colors) -> String {
    let mut text = format!("#define BRICK {CELLS}\nconst ivec3 ATLAS = {};\n", integers3(atlas));
    for (name, value) in [("VOXEL", voxel), ("MAX_OPACITY", bricks::MAX_OPACITY), ("MAX_COLOR", MAX_COLOR)] {
        let _ = writeln!(text, "const float {name} = {value:?};");
    }
    for (name, channel) in CHANNELS.iter().zip(&colors.channels) {
        for (kind, [a, x, y, z]) in [("LOW", &channel.low), ("RANGE", &channel.range)] {
            let name = name.to_uppercase();
            let _ = writeln!(text, "const vec4 {name}_{kind} = vec4({a:?}, {x:?}, {y:?}, {z:?});");
        }
    }
    text
}

/// Subtracts from each byte the one before it in its row of [`POINTS`], modulo 256: smooth values deflate well.
fn differences(bytes: &[u8]) -> Vec<u8> {
    let of_row = |row: &[u8]| -> Vec<u8> {
        let before = std::iter::once(0).chain(row.iter().copied());
        row.iter().zip(before).map(|(byte, before)| byte.wrapping_sub(before)).collect()
    };
    bytes.chunks(POINTS).flat_map(of_row).collect()
}

#[cfg(test)]
mod tests {
    use infonerf_train::{Config, Preset};

    use super::*;

    #[test]
    fn slow_fields_are_baked_coarsely() {
        let mut field = Config::from_table(Preset::Paper.table()).unwrap().field;
        assert_eq!((resolution(&field), live_resolution(&field)), (128, 64));
        let FieldConfig::Nerf(nerf) = &mut field else { panic!("the paper's field is NeRF's") };
        (nerf.layers, nerf.width) = (4, 64);
        assert_eq!((resolution(&field), live_resolution(&field)), (256, 96));
    }

    #[test]
    fn textures_hold_all_bricks() {
        assert_eq!(atlas(0), [1, 1, 1]);
        for bricks in [1, 2, 8, 9, 100, bricks::MAX_BRICKS] {
            let sides = atlas(bricks);
            assert!(sides.iter().product::<usize>() >= bricks);
            assert!(sides.iter().all(|side| side * POINTS <= 256), "WebGL2 promises no more: {sides:?}");
        }
    }
}
