//! Writing a procedural scene as a folder in Blender's format.

use std::fs;
use std::path::Path;

use rayon::prelude::*;
use serde_json::{Value, json};

use crate::{Aabb, Body, Camera, SceneError, loaders, procedural};

/// The file that marks a folder as written here. It holds the scene's name.
const MARK: &str = ".infonerf-export";

/// Writes the procedural scene `name` at `size`² pixels into the folder `dir`, in Blender's format:
/// `transforms_{train,test}.json`, `{train,test}/r_<id>.png` (straight RGBA, 8 bits) and, beside the
/// test images, `r_<id>_depth.npy` (f32, exact distance along each pixel's unit ray, +∞ where it
/// hits nothing).
///
/// Of a scene with a body, `vertices.ply` has its vertices, for `field.vertices`.
///
/// Loading the folder at its own size gives the views of the procedural scene bit for bit. `dir` is
/// made if need be; files of the same names in one that this wrote before are overwritten.
///
/// # Errors
/// `name` is no procedural scene, `size` is 0 or above 16384, `dir` holds something that this did not write, or a file
/// cannot be written.
pub fn export(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    procedural::check_name(name)?;
    if size == 0 || size > 16_384 {
        return Err(SceneError::request("image_size", "a size from 1 to 16384 pixels", size));
    }
    claim(dir, name)?;
    let (train, test) = procedural::cameras(name, size)?;
    let extent = procedural::extent(name)?;
    if let Some(body) = procedural::body(name)? {
        write_vertices(&dir.join("vertices.ply"), &body)?;
    }
    write_split(name, dir, "train", &train, extent, false)?;
    write_split(name, dir, "test", &test, extent, true)
}

/// Makes `dir` and marks it as ours, unless it holds something else.
pub(crate) fn claim(dir: &Path, name: &str) -> Result<(), SceneError> {
    let mark = dir.join(MARK);
    if !mark.is_file() && fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some()) {
        let expected = "a new or empty folder, or one that an export wrote";
        return Err(SceneError::malformed(dir, expected, "it holds other files, which would be overwritten"));
    }
    fs::create_dir_all(dir).map_err(|e| SceneError::io(dir, e))?;
    fs::write(&mark, format!("{name}\n")).map_err(|e| SceneError::io(&mark, e))
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

/// Writes one image, and its depth if wanted, and gives its frame.
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
        loaders::write_depth(&path, camera.width, camera.height, &view.depth)?;
        frame["ray_depth_file_path"] = json!(format!("./{split}/r_{id}_depth.npy"));
    }
    Ok(frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneRequest, SceneSource, TestProtocol, ViewSelection, load};

    #[test]
    fn an_exported_scene_loads_back_to_the_same_pixels() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("orrery");
        export("orrery", 24, &dir).unwrap();
        let request = SceneRequest {
            train: ViewSelection::All,
            test: TestProtocol::All,
            image_size: Some(24),
            background: [0.1, 0.7, 1.0],
            ..Default::default()
        };
        let loaded = load(&SceneSource::Folder { path: dir }, &request).unwrap();
        let direct = load(&SceneSource::Procedural("orrery".into()), &request).unwrap();
        for (a, b) in loaded.test.iter().zip(&direct.test) {
            assert_eq!(a, b);
        }
        for (a, b) in loaded.train.iter().zip(&direct.train) {
            assert_eq!((&a.image, &a.camera, &a.name), (&b.image, &b.camera, &b.name));
        }
        assert_eq!(loaded.all_train_cameras, direct.all_train_cameras);
        assert_eq!((loaded.near, loaded.far), (direct.near, direct.far));
        assert_eq!((loaded.bounds, loaded.name), (direct.bounds, direct.name));
    }

    #[test]
    fn a_body_goes_along() {
        let guard = tempfile::tempdir().unwrap();
        export("figure", 8, guard.path()).unwrap();
        let text = fs::read_to_string(guard.path().join("vertices.ply")).unwrap();
        let lines = text.lines().skip_while(|line| *line != "end_header").skip(1);
        let numbers: Vec<f32> = lines.flat_map(|line| line.split(' ').map(|x| x.parse().unwrap())).collect();
        let body = procedural::body("figure").unwrap().unwrap();
        assert_eq!(numbers, body.vertices.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>());
        assert!(text.contains(&format!("element vertex {}\n", body.vertices.len())));
    }

    #[test]
    fn bad_requests_are_refused() {
        let guard = tempfile::tempdir().unwrap();
        let error = export("tree", 8, guard.path()).unwrap_err().to_string();
        assert!(error.contains("`tree`") && error.contains("castle, crane, knot, orrery"));
        assert!(export("knot", 0, guard.path()).is_err());
        let file = guard.path().join("file");
        fs::write(&file, "").unwrap();
        let error = export("knot", 8, &file.join("below")).unwrap_err().to_string();
        assert!(error.contains("below"), "{error}");
    }

    #[test]
    fn a_folder_of_somebody_elses_is_left_alone() {
        let guard = tempfile::tempdir().unwrap();
        let json = guard.path().join("transforms_train.json");
        fs::write(&json, "{}").unwrap();
        let error = export("knot", 8, guard.path()).unwrap_err().to_string();
        assert!(error.contains("a new or empty folder"), "{error}");
        assert_eq!(fs::read_to_string(&json).unwrap(), "{}");
        fs::remove_file(&json).unwrap();
        for _ in 0..2 {
            export("knot", 8, guard.path()).unwrap();
        }
    }
}
