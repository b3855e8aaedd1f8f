//! Writing procedural scenes as folders, in the formats of the data sets that few-view methods are measured on.

mod blender;
mod dtu;
mod llff;
pub(crate) mod pickle;
mod transforms;
mod zju;

pub use transforms::transforms;

#[cfg(test)]
pub(crate) use dtu::projection;
#[cfg(test)]
pub(crate) use zju::{annotations, lens};

use std::fs;
use std::path::Path;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use infonerf_procedural as procedural;
use infonerf_scene::{Camera, Format, Image, SceneError};

/// The file that marks a folder as written here. It holds the format's name.
const MARK: &str = ".infonerf-export";
/// Background of photographs of a scene that has nothing behind it.
const WHITE: [f32; 3] = [1.0; 3];

/// Writes the procedural scene `name` into the folder `dir`, with images of `size`² pixels:
///
/// - [`Format::Blender`]: `transforms_{train,test}.json`, RGBA images, exact depth next to the test images. Loading the
///   folder at its own size gives the views of the procedural scene bit for bit. Of a scene with a body,
///   `vertices.ply` has its vertices, for `field.vertices`.
/// - [`Format::Llff`]: `poses_bounds.npy` and `images`, 40 photographs, with exact depths of the nearest and the farthest
///   point.
/// - [`Format::Dtu`]: `cameras_sphere.npz`, `image`, `mask`, as IDR and NeuS have them: 49 photographs with the subject's
///   masks, the unit sphere about it.
/// - [`Format::Zju`]: `annots.npy`, `mask_cihp` and, of a scene with a body, `new_vertices` and `new_params`: one frame
///   of up to 23 cameras behind lenses that distort.
///
/// A photograph has no coverage: what a scene leaves transparent is white. `dir` is made if need be; files of the same
/// names in one that this wrote before in the same format are overwritten.
///
/// # Errors
/// `name` is no procedural scene, `size` is 0 or above 16384, the format is another, `dir` holds something that this did
/// not write, or a file cannot be written.
pub fn export(name: &str, size: u32, format: Format, dir: &Path) -> Result<(), SceneError> {
    procedural::check_name(name)?;
    if size == 0 || size > 16_384 {
        return Err(SceneError::request("image_size", "a size from 1 to 16384 pixels", size));
    }
    let write = match format {
        Format::Blender => blender::write,
        Format::Llff => llff::write,
        Format::Dtu => dtu::write,
        Format::Zju => zju::write,
        _ => return Err(SceneError::request("format", "Blender, LLFF, DTU or ZJU-MoCap", format)),
    };
    claim(dir, format)?;
    write(name, size, dir)
}

/// Makes `dir` and marks it as ours, unless it holds something else.
fn claim(dir: &Path, format: Format) -> Result<(), SceneError> {
    let path = dir.join(MARK);
    let mark = format!("{format}\n");
    let ours = fs::read_to_string(&path).is_ok_and(|found| found == mark);
    if !ours && fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some()) {
        let expected = format!("a new or empty folder, or one that an export in {format}'s format wrote");
        return Err(SceneError::malformed(dir, expected, "it holds other files"));
    }
    make(dir)?;
    fs::write(&path, mark).map_err(|e| SceneError::io(&path, e))
}

fn make(folder: &Path) -> Result<(), SceneError> {
    fs::create_dir_all(folder).map_err(|e| SceneError::io(folder, e))
}

/// Image and depth that a camera records of a scene.
struct ExportedView {
    camera: Camera,
    image: Image,
    /// Depth as in [`procedural::Rendering`].
    depth: Vec<f32>,
}

/// Returns photographs of the scene `name`.
fn photographs(name: &str, cameras: Vec<Camera>) -> Result<Vec<ExportedView>, SceneError> {
    let photograph = |camera: Camera| {
        let procedural::Rendering { rgba, depth } = procedural::render(name, &camera)?;
        Ok(ExportedView { camera, image: rgba.to_f32().composite(WHITE), depth })
    };
    cameras.into_par_iter().map(photograph).collect()
}

/// Writes the subject's mask in a photograph, white on black.
fn write_mask(path: &Path, photograph: &ExportedView, mask: &[bool]) -> Result<(), SceneError> {
    let rgb = mask.iter().map(|&subject| if subject { [1.0; 3] } else { [0.0; 3] }).collect();
    Image { rgb, ..photograph.image.clone() }.write_png(path)
}

/// Returns a camera in OpenCV's terms (x right, y down, z forward): the rotation from world to camera and the optical
/// centre.
fn opencv(camera: &Camera) -> (DMat3, DVec3) {
    let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    (flip * camera.rotation().transpose(), camera.position_f64())
}

/// Returns `K`, for pixels whose centres are whole numbers.
fn intrinsics(camera: &Camera) -> DMat3 {
    let centre = DVec3::new(camera.cx - 0.5, camera.cy - 0.5, 1.0);
    DMat3::from_cols(DVec3::X * camera.fx, DVec3::Y * camera.fy, centre)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneSource, load};
    use infonerf_scene::{SceneRequest, TestProtocol, ViewSelection};

    #[test]
    fn an_exported_scene_loads_back_to_the_same_pixels() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("orrery");
        export("orrery", 24, Format::Blender, &dir).unwrap();
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
        assert_eq!((loaded.space.near, loaded.space.far), (direct.space.near, direct.space.far));
        assert_eq!((loaded.space.bounds, loaded.name), (direct.space.bounds, direct.name));
    }

    #[test]
    fn a_body_goes_along() {
        let guard = tempfile::tempdir().unwrap();
        export("figure", 8, Format::Blender, guard.path()).unwrap();
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
        let error = export("tree", 8, Format::Blender, guard.path()).unwrap_err().to_string();
        assert!(error.contains("`tree`") && error.contains("castle, crane, knot, orrery"));
        assert!(export("knot", 0, Format::Blender, guard.path()).is_err());
        let file = guard.path().join("file");
        fs::write(&file, "").unwrap();
        let error = export("knot", 8, Format::Blender, &file.join("below")).unwrap_err().to_string();
        assert!(error.contains("below"), "{error}");
    }

    #[test]
    fn a_folder_of_somebody_elses_is_left_alone() {
        let guard = tempfile::tempdir().unwrap();
        let json = guard.path().join("transforms_train.json");
        fs::write(&json, "{}").unwrap();
        let error = export("knot", 8, Format::Blender, guard.path()).unwrap_err().to_string();
        assert!(error.contains("a new or empty folder"), "{error}");
        assert_eq!(fs::read_to_string(&json).unwrap(), "{}");
        fs::remove_file(&json).unwrap();
        for _ in 0..2 {
            export("knot", 8, Format::Blender, guard.path()).unwrap();
        }
        let error = export("knot", 8, Format::Llff, guard.path()).unwrap_err().to_string();
        assert!(error.contains("in LLFF's format"), "a folder in two formats: {error}");
        assert!(export("knot", 8, Format::Colmap, guard.path()).unwrap_err().to_string().contains("LLFF, DTU"));
    }
}
