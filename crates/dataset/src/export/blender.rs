//! NeRF's synthetic scenes: `transforms_{train,test}.json` and RGBA images.

use std::fs;
use std::path::Path;

use infonerf_procedural as procedural;
use infonerf_scene::{Aabb, Body, Camera, SceneError};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::files::npy;

/// Writes `transforms_{train,test}.json`, `{train,test}/r_<id>.png` (straight RGBA, 8 bits) and, next to the test
/// images, `r_<id>_depth.npy` (f32, exact distance along each pixel's unit ray, +∞ where it hits nothing).
///
/// Of a scene with a body, `vertices.ply` has its vertices, for `field.vertices`. Loading the folder at its own size
/// gives the views of the procedural scene bit for bit.
pub(super) fn write(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let (train, test) = procedural::cameras(name, size)?;
    let extent = procedural::extent(name)?;
    if let Some(body) = procedural::body(name)? {
        write_vertices(&dir.join("vertices.ply"), &body)?;
    }
    write_split(name, dir, "train", &train, extent, false)?;
    write_split(name, dir, "test", &test, extent, true)
}

/// Writes the images of a split and its `transforms_<split>.json`; `extent` is near, far and the box.
fn write_split(
    name: &str,
    dir: &Path,
    split: &str,
    cameras: &[Camera],
    (near, far, bounds): (f32, f32, Aabb),
    with_depth: bool,
) -> Result<(), SceneError> {
    let folder = dir.join(split);
    fs::create_dir_all(&folder).map_err(|e| SceneError::io(&folder, e))?;
    let results: Vec<_> = cameras
        .par_iter()
        .enumerate()
        .map(|(id, camera)| write_view(name, &folder, split, id, camera, with_depth))
        .collect();
    let frames = results.into_iter().collect::<Result<Vec<_>, _>>()?;
    let transforms = json!({
        "camera_angle_x": procedural::field_of_view(name),
        "near": near,
        "far": far,
        "aabb": [bounds.min.to_array(), bounds.max.to_array()],
        "frames": frames,
    });
    // The poses come last: a folder that has them is complete.
    let path = dir.join(format!("transforms_{split}.json"));
    let text = format!("{transforms:#}\n");
    fs::write(&path, text).map_err(|e| SceneError::io(&path, e))
}

/// Writes the vertices of a body as PLY, in text that reads back bit for bit.
fn write_vertices(path: &Path, body: &Body) -> Result<(), SceneError> {
    let properties = ["x", "y", "z"].map(|axis| format!("property float {axis}\n")).concat();
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n{properties}end_header\n", body.vertices.len());
    text.extend(body.vertices.iter().map(|v| format!("{} {} {}\n", v.x, v.y, v.z)));
    fs::write(path, text).map_err(|e| SceneError::io(path, e))
}

/// Writes one image, and its depth if wanted, and returns its entry of `frames`.
fn write_view(
    name: &str,
    folder: &Path,
    split: &str,
    id: usize,
    camera: &Camera,
    with_depth: bool,
) -> Result<Value, SceneError> {
    let view = procedural::render(name, camera)?;
    view.rgba.write_png(&folder.join(format!("r_{id}.png")))?;
    let rows = camera.to_world.transpose().to_cols_array_2d();
    let mut frame = json!({"file_path": format!("./{split}/r_{id}"), "transform_matrix": rows});
    if with_depth {
        let path = folder.join(format!("r_{id}_depth.npy"));
        npy::write(&path, &[u64::from(camera.height), u64::from(camera.width)], &view.depth)?;
        frame["ray_depth_file_path"] = json!(format!("./{split}/r_{id}_depth.npy"));
    }
    Ok(frame)
}
