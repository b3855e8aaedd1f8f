//! NeRF's synthetic scenes: `transforms_{train,test}.json` and RGBA images.

use std::path::Path;

use infonerf_procedural as procedural;
use infonerf_scene::{Body, Camera, SceneError};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::capture::in_order;
use crate::files::{make_folder, npy, write_file};

/// Writes `transforms_{train,test}.json`, `{train,test}/r_<id>.png` (straight RGBA, 8 bits) and, next to the test
/// images, `r_<id>_depth.npy` (f32, exact distance along each pixel's unit ray, +∞ where it hits nothing).
pub(super) fn write(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let (train, test) = procedural::cameras(name, size)?;
    let (near, far, bounds) = procedural::extent(name)?;
    if let Some(body) = procedural::body(name)? {
        write_vertices(&dir.join("vertices.ply"), &body)?;
    }
    for (split, cameras) in [("train", train), ("test", test)] {
        make_folder(&dir.join(split))?;
        let view = |(id, camera): (usize, &Camera)| -> Result<Value, SceneError> {
            let view = procedural::render(name, camera)?;
            view.rgba.write_png(&dir.join(format!("{split}/r_{id}.png")))?;
            let rows = camera.to_world.transpose().to_cols_array_2d();
            let mut frame = json!({"file_path": format!("./{split}/r_{id}"), "transform_matrix": rows});
            if split == "test" {
                let path = format!("./{split}/r_{id}_depth.npy");
                npy::write(&dir.join(&path), &[u64::from(camera.height), u64::from(camera.width)], &view.depth)?;
                frame["ray_depth_file_path"] = json!(path);
            }
            Ok(frame)
        };
        let frames = in_order(cameras.par_iter().enumerate().map(view))?;
        let fov = procedural::field_of_view(name);
        let bounds = [bounds.min.to_array(), bounds.max.to_array()];
        let transforms = json!({"camera_angle_x": fov, "near": near, "far": far, "aabb": bounds, "frames": frames});
        // The poses come last: a folder that has them is complete.
        write_file(&dir.join(format!("transforms_{split}.json")), format!("{transforms:#}\n"))?;
    }
    Ok(())
}

/// Writes the vertices of a body as PLY, in text that reads back bit for bit.
fn write_vertices(path: &Path, body: &Body) -> Result<(), SceneError> {
    let properties = ["x", "y", "z"].map(|axis| format!("property float {axis}\n")).concat();
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n{properties}end_header\n", body.vertices.len());
    text.extend(body.vertices.iter().map(|v| format!("{} {} {}\n", v.x, v.y, v.z)));
    write_file(path, text)
}
