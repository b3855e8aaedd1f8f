//! Writing procedural scenes as folders, in the formats of the data sets that few-view methods are measured on.

mod blender;
mod photographs;
mod transforms;

pub use transforms::transforms;

#[cfg(test)]
pub(crate) use photographs::{annotations, lens, matrices};

use std::fs;
use std::path::Path;

use infonerf_procedural as procedural;
use infonerf_scene::{Format, SceneError};

use crate::files::{make_folder, write_file};

/// The file that marks a folder as written here. It holds the format's name.
const MARK: &str = ".infonerf-export";

/// Writes the procedural scene `name` into the folder `dir`, with images of `size`² pixels:
///
/// - [`Format::Blender`]: `transforms_{train,test}.json`, RGBA images, exact depth next to the test images. A scene
///   with a body also gets `vertices.ply`, the file for `field.vertices`. Loading the folder at its own size gives the
///   views of the procedural scene bit for bit.
/// - [`Format::Llff`]: `poses_bounds.npy` and `images`, 40 photographs, with exact depths of the ends.
/// - [`Format::Dtu`]: `cameras_sphere.npz`, `image` and `mask` as in IDR and NeuS: 49 photographs, masks of the
///   subject, and the unit sphere around it.
/// - [`Format::Zju`]: `annots.npy`, `mask_cihp` and, for a scene with a body, `new_vertices` and `new_params`: one
///   frame of up to 23 cameras with lens distortion.
///
/// Photographs are opaque: transparent parts of a scene become white. `dir` is created if needed; files of the same
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
        Format::Llff => photographs::write_llff,
        Format::Dtu => photographs::write_dtu,
        Format::Zju => photographs::write_zju,
        _ => return Err(SceneError::request("format", "Blender, LLFF, DTU or ZJU-MoCap", format)),
    };
    mark_folder(dir, format)?;
    write(name, size, dir)
}

/// Creates `dir` and marks it as an export. Returns an error if it has other files.
fn mark_folder(dir: &Path, format: Format) -> Result<(), SceneError> {
    let path = dir.join(MARK);
    let mark = format!("{format}\n");
    let ours = fs::read_to_string(&path).is_ok_and(|found| found == mark);
    if !ours && fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some()) {
        let expected = format!("a new or empty folder, or one that an export in {format}'s format wrote");
        return Err(SceneError::malformed(dir, expected, "it holds other files"));
    }
    make_folder(dir)?;
    write_file(&path, mark)
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{Camera, Layout, RgbaImage, Scene, SceneRequest, TestProtocol};

    use super::*;
    use crate::load as load_from;
    use crate::loaders::testing::{assert_same_rays, load, request};
    use crate::source::SceneSource;

    #[test]
    fn an_exported_scene_loads_back_to_the_same_pixels() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("orrery");
        export("orrery", 24, Format::Blender, &dir).unwrap();
        let request = SceneRequest { image_size: Some(24), background: [0.1, 0.7, 1.0], ..request() };
        let loaded = load(&dir, &request).unwrap();
        let direct = load_from(&SceneSource::Procedural("orrery".into()), &request).unwrap();
        assert!(loaded.test == direct.test);
        for (a, b) in loaded.train.iter().zip(&direct.train) {
            assert_eq!((&a.image, &a.camera, &a.name), (&b.image, &b.camera, &b.name));
        }
        assert_eq!(loaded.all_train_cameras, direct.all_train_cameras);
        assert_eq!((loaded.space.near, loaded.space.far), (direct.space.near, direct.space.far));
        assert_eq!((loaded.space.bounds, loaded.name), (direct.space.bounds, direct.name));
        // The vertices of a body are exported too.
        let dir = guard.path().join("figure");
        export("figure", 8, Format::Blender, &dir).unwrap();
        let text = fs::read_to_string(dir.join("vertices.ply")).unwrap();
        let lines = text.lines().skip_while(|line| *line != "end_header").skip(1);
        let numbers: Vec<f32> = lines.flat_map(|line| line.split(' ').map(|x| x.parse().unwrap())).collect();
        let body = procedural::body("figure").unwrap().unwrap();
        assert_eq!(numbers, body.vertices.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>());
        assert!(text.contains(&format!("element vertex {}\n", body.vertices.len())));
    }

    /// Exports and loads a scene with published views. Returns it with the cameras of the export.
    fn read_back(name: &str, format: Format, train: &str) -> (Scene, Vec<Camera>) {
        let guard = tempfile::tempdir().unwrap();
        export(name, 16, format, guard.path()).unwrap();
        let chosen = SceneRequest { train: train.parse().unwrap(), test: TestProtocol::Split, ..request() };
        let scene = load(guard.path(), &chosen).unwrap();
        (scene, procedural::photographs(name, 16, if format == Format::Dtu { 49 } else { 40 }))
    }

    #[test]
    fn a_table_reads_back() {
        let (scene, cameras) = read_back("table", Format::Dtu, "regnerf-3");
        assert_eq!(scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), [25, 22, 28]);
        assert_eq!((scene.format, scene.test.len(), scene.warnings.len()), (Format::Dtu, 25, 0));
        for view in scene.train.iter().chain(&scene.test) {
            let camera = &cameras[view.id];
            let mask = view.mask.as_deref().unwrap();
            assert_eq!(mask, procedural::object_mask("table", camera).unwrap());
            // Masked pixels show points in the unit sphere.
            let shown = procedural::render("table", camera).unwrap();
            let apart = |a: &Camera, b: &Camera| a.position().distance(b.position());
            let scale = apart(camera, &cameras[0]) / apart(&view.camera, &scene.all_train_cameras[0]);
            for (i, mask) in mask.iter().enumerate() {
                let (x, y) = ((i % 16) as f32 + 0.5, (i / 16) as f32 + 0.5);
                let (a, b) = (view.camera.ray(x, y), camera.ray(x, y));
                assert!((a.direction - b.direction).length() < 1e-5);
                assert!(!mask || view.id == 0 || a.at(shown.depth[i] / scale).length() < 1.0 + 1e-3);
            }
        }
    }

    #[test]
    fn a_room_reads_back() {
        let (scene, cameras) = read_back("room", Format::Llff, "regnerf-3");
        assert_eq!((scene.format, scene.space.layout), (Format::Llff, Layout::Forward));
        assert_eq!((scene.train.len(), scene.test.len()), (3, 5));
        let names: Vec<_> = scene.train.iter().map(|view| view.name.as_str()).collect();
        assert_eq!(names, ["images/image001", "images/image020", "images/image039"]);
        let shown = procedural::render("room", &cameras[39]).unwrap().rgba.to_f32();
        assert_eq!(*scene.train[2].image, RgbaImage { has_alpha: false, ..shown }.composite([0.0; 3]));
        // Poses are moved and scaled by the loader: angles stay, distances keep their ratios.
        let [a, b, c] = [0, 1, 2].map(|i| &scene.train[i].camera);
        let [p, q, r] = [1, 20, 39].map(|i| &cameras[i]);
        for (x, y) in [(0.0, 0.0), (12.0, 3.0)] {
            let cosine = |a: &Camera, b: &Camera| a.ray(x, y).direction.dot(b.ray(y, x).direction);
            assert!((cosine(a, b) - cosine(p, q)).abs() < 1e-5);
        }
        let apart = |a: &Camera, b: &Camera| a.position().distance(b.position());
        let factor = apart(c, a) / apart(r, p);
        assert!((apart(b, a) / apart(q, p) / factor - 1.0).abs() < 1e-4);
        // Near and far are the depths of visible points.
        let (near, far) = (scene.space.near / 0.9 / factor, scene.space.far / factor);
        assert!((0.4..3.0).contains(&near) && (3.0..9.0).contains(&far), "{near} {far}");
    }

    #[test]
    fn a_person_reads_back() {
        let (scene, cameras) = read_back("figure", Format::Zju, "infonerf-4");
        assert_eq!((scene.format, scene.train.len(), scene.test.len()), (Format::Zju, 4, 19));
        assert_eq!(scene.space.body, procedural::body("figure").unwrap());
        for view in scene.train.iter().chain(&scene.test) {
            let camera = cameras[view.id].with_lens(lens());
            assert_same_rays(&view.camera, &camera);
            assert_eq!(view.mask.as_deref().unwrap(), procedural::object_mask("figure", &camera).unwrap());
        }
    }

    #[test]
    fn bad_requests_are_refused_and_other_files_left_alone() {
        let guard = tempfile::tempdir().unwrap();
        let (dir, json) = (guard.path(), guard.path().join("transforms_train.json"));
        let fault = |name, size, format, dir: &Path| export(name, size, format, dir).unwrap_err().to_string();
        let error = fault("tree", 8, Format::Blender, dir);
        assert!(error.contains("`tree`") && error.contains("castle, crane, knot, orrery"));
        assert!(fault("knot", 0, Format::Blender, dir).contains("image_size"));
        fs::write(&json, "{}").unwrap();
        assert!(fault("knot", 8, Format::Blender, &json.join("below")).contains("below"));
        assert!(fault("knot", 8, Format::Blender, dir).contains("a new or empty folder"));
        assert_eq!(fs::read_to_string(&json).unwrap(), "{}");
        fs::remove_file(&json).unwrap();
        for _ in 0..2 {
            export("knot", 8, Format::Blender, dir).unwrap();
        }
        assert!(fault("knot", 8, Format::Llff, dir).contains("in LLFF's format"), "a folder in two formats");
        assert!(fault("knot", 8, Format::Colmap, dir).contains("LLFF, DTU"));
    }
}
