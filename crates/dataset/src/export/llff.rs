//! Forward-facing captures in LLFF's format: `poses_bounds.npy` and `images`.

use std::path::Path;

use infonerf_procedural as procedural;
use infonerf_scene::SceneError;

use super::{ExportedView, make, photographs};
use crate::files::npy;

/// Number of photographs.
const VIEWS: usize = 40;

/// Writes `images/image<NNN>.png` and a row for each: the camera's down, right and backward axes, its position, and
/// (height, width, focal length) as columns of a 3×5 matrix, then the depths of the nearest and the farthest point.
pub(super) fn write(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let (near, far, _) = procedural::extent(name)?;
    let photographs = photographs(name, procedural::photographs(name, size, VIEWS))?;
    make(&dir.join("images"))?;
    for (i, photograph) in photographs.iter().enumerate() {
        photograph.image.write_png(&dir.join(format!("images/image{i:03}.png")))?;
    }
    let rows: Vec<f64> = photographs.iter().flat_map(|p| row(p, (near, far))).collect();
    npy::write(&dir.join("poses_bounds.npy"), &[photographs.len() as u64, 17], &rows)
}

/// Returns the row of a photograph; `extent` is near and far where it shows nothing.
fn row(photograph: &ExportedView, extent: (f32, f32)) -> [f64; 17] {
    let camera = &photograph.camera;
    let [x, y, z, at] = [0, 1, 2, 3].map(|column| camera.to_world.col(column));
    let size = [f64::from(camera.height), f64::from(camera.width), camera.fx];
    let (near, far) = depths(photograph).unwrap_or(extent);
    let mut row = [0.0; 17];
    for i in 0..3 {
        row[5 * i..5 * i + 5].copy_from_slice(&[-y[i], x[i], z[i], at[i], size[i]]);
    }
    row[15..].copy_from_slice(&[f64::from(near), f64::from(far)]);
    row
}

/// Returns the least and the greatest depth along the camera's axis.
fn depths(photograph: &ExportedView) -> Option<(f32, f32)> {
    let width = photograph.camera.width as usize;
    let depth = |(i, &distance): (usize, &f32)| {
        let ray = photograph.camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        distance * ray.cosine
    };
    let depths = photograph.depth.iter().enumerate().filter(|(_, d)| d.is_finite()).map(depth);
    depths.fold(None, |range, d| Some(range.map_or((d, d), |(near, far): (f32, f32)| (near.min(d), far.max(d)))))
}
