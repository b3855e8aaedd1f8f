//! Scans in the format of IDR and NeuS: projection matrices, images, masks.

use std::path::Path;

use glam::{DMat3, DMat4, DVec3, Vec3};
use infonerf_procedural as procedural;
use infonerf_scene::{Aabb, Camera, SceneError};

use super::{ExportedView, intrinsics, make, opencv, photographs, write_mask};
use crate::files::npz;

/// Number of views of a full scan, which the published protocols need.
const VIEWS: usize = 49;

/// Writes `image/<NNNNNN>.png`, `mask/<NNN>.png` and `cameras_sphere.npz`: `world_mat_<i>` is `K [R | t]`, and
/// `scale_mat_<i>` takes the unit sphere to the one about the subject.
pub(super) fn write(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let photographs = photographs(name, procedural::photographs(name, size, VIEWS))?;
    for folder in ["image", "mask"] {
        make(&dir.join(folder))?;
    }
    let mut seen = Vec::new();
    for (i, photograph) in photographs.iter().enumerate() {
        let mask = procedural::object_mask(name, &photograph.camera)?;
        seen.extend(points(photograph, &mask));
        photograph.image.write_png(&dir.join(format!("image/{i:06}.png")))?;
        write_mask(&dir.join(format!("mask/{i:03}.png")), photograph, &mask)?;
    }
    let (centre, radius) = sphere(&seen);
    let scale = DMat4::from_translation(centre) * DMat4::from_scale(DVec3::splat(radius));
    npz::write(&dir.join("cameras_sphere.npz"), &matrices(photographs.iter().map(|p| &p.camera), scale))
}

/// Returns `world_mat_<i>` and `scale_mat_<i>` of cameras that look at what `scale` takes the unit sphere to.
pub(crate) fn matrices<'a>(cameras: impl Iterator<Item = &'a Camera>, scale: DMat4) -> Vec<npz::NamedArray> {
    let of = |(i, camera): (usize, &Camera)| {
        let matrices = [("world", projection(camera)), ("scale", scale)];
        matrices.map(|(kind, m)| (format!("{kind}_mat_{i}"), vec![4, 4], m.transpose().to_cols_array().to_vec()))
    };
    cameras.enumerate().flat_map(of).collect()
}

/// Returns `K [R | t]` and a last row of (0, 0, 0, 1): takes a world point to a pixel, whose centres are whole numbers.
fn projection(camera: &Camera) -> DMat4 {
    let (rotation, centre) = opencv(camera);
    let m: DMat3 = intrinsics(camera) * rotation;
    let t = -(m * centre);
    DMat4::from_cols(m.x_axis.extend(0.0), m.y_axis.extend(0.0), m.z_axis.extend(0.0), t.extend(1.0))
}

/// Returns the surface points that the subject's pixels show.
fn points(photograph: &ExportedView, mask: &[bool]) -> Vec<Vec3> {
    let width = photograph.camera.width as usize;
    let subject = (0..mask.len()).filter(|&i| mask[i] && photograph.depth[i].is_finite());
    let ray = |i: usize| photograph.camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
    subject.map(|i| ray(i).at(photograph.depth[i])).collect()
}

/// Returns a sphere around the centre of the points' bounding box that contains all `points`, with a margin of a
/// twentieth.
fn sphere(points: &[Vec3]) -> (DVec3, f64) {
    let centre = Aabb::containing(points.iter().copied()).map_or(Vec3::ZERO, |bounds| bounds.centre());
    let farthest = points.iter().map(|p| p.distance(centre)).fold(1e-3, f32::max);
    (centre.as_dvec3(), 1.05 * f64::from(farthest))
}
