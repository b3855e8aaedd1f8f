//! Loaders of scenes in folders. A new format is one new file and one line in [`FORMATS`].

mod blender;
mod colmap;
pub(crate) mod dtu;
pub(crate) mod llff;
mod nerfstudio;
mod pose;
pub(crate) mod transforms;
pub(crate) mod zju;

pub(crate) use pose::read_pose;

use std::path::Path;

use infonerf_scene::{Format, SceneError, SceneRequest};

use crate::capture::Found;
use crate::files::entries;
use crate::photographs::{missing_poses_error, video_advice};

type Reader = for<'a> fn(&'a Path, &SceneRequest) -> Result<Found<'a>, SceneError>;

/// Known formats in the order of detection, each with the file that marks a folder and with its reader.
const FORMATS: [(Format, &str, Reader); 6] = [
    (Format::Blender, blender::MARKER, blender::read),
    (Format::Transforms, nerfstudio::MARKER, nerfstudio::read),
    (Format::Llff, llff::MARKER, llff::read),
    (Format::Dtu, dtu::MARKER, dtu::read),
    (Format::Zju, zju::MARKER, zju::read),
    (Format::Colmap, colmap::MARKER, colmap::read),
];

fn has_marker(dir: &Path, format: Format, marker: &str) -> bool {
    match format {
        Format::Dtu => dtu::cameras_file(dir).is_some(),
        Format::Colmap => !crate::colmap::models(dir).is_empty(),
        _ => dir.join(marker).is_file(),
    }
}

pub(crate) fn is_scene(dir: &Path) -> bool {
    FORMATS.iter().any(|(format, marker, _)| has_marker(dir, *format, marker))
}

/// Reads the folder `dir` without decoding images, in the requested format or else in the first known one that
/// succeeds. Each known format that failed before adds a warning.
pub(crate) fn read<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Found<'a>, SceneError> {
    request.check()?;
    if dir.is_file() {
        let reason = video_advice(dir).unwrap_or_else(|| "it is a file; give its folder, or unpack it".into());
        return Err(SceneError::malformed(dir, "the folder of a scene", reason));
    }
    if !dir.is_dir() {
        return Err(SceneError::NotFound { path: dir.into(), expected: "the folder of a scene".into() });
    }
    let asked: Vec<_> =
        FORMATS.into_iter().filter(|(known, ..)| request.format.is_none_or(|format| format == *known)).collect();
    let mut faults: Vec<(Format, SceneError)> = Vec::new();
    for (format, _, read) in asked.iter().filter(|(format, marker, _)| has_marker(dir, *format, marker)) {
        match read(dir, request) {
            Ok(mut found) => {
                let broken = |(other, error): &(_, _)| format!("read as {format}: as {other} it is broken: {error}");
                found.warnings.extend(faults.iter().map(broken));
                return Ok(found);
            }
            Err(error) => faults.push((*format, error)),
        }
    }
    if !faults.is_empty() {
        return Err(faults.swap_remove(0).1);
    }
    let markers = asked.iter().map(|(_, marker, _)| *marker).collect::<Vec<_>>().join(", ");
    let other = missing_poses_error(dir).or_else(|| elsewhere(dir));
    let reason = if entries(dir).is_empty() { "it is empty" } else { "it has none of them" };
    Err(other.unwrap_or_else(|| SceneError::malformed(dir, format!("a scene folder with one of {markers}"), reason)))
}

/// Returns the error about a folder whose scene is one or two levels below, or in the format of an app.
fn elsewhere(dir: &Path) -> Option<SceneError> {
    const MAX_FOLDERS: usize = 30;
    let folders = |dir: &Path| entries(dir).into_iter().filter(|path| path.is_dir()).take(MAX_FOLDERS);
    let mut below = folders(dir).flat_map(|folder| [folder.clone()].into_iter().chain(folders(&folder)));
    let apps = [("keyframes/corrected_cameras", "polycam"), ("rgbd", "record3d")];
    let reason = match apps.iter().find(|(mark, _)| dir.join(mark).is_dir()) {
        Some((_, app)) => format!("it has the format of an app; nerfstudio's `ns-process-data {app}` converts it"),
        None => format!("a scene is in {}; give that folder", below.find(|folder| is_scene(folder))?.display()),
    };
    Some(SceneError::malformed(dir, "the folder of a scene", reason))
}

#[cfg(test)]
pub(crate) mod testing {
    //! Small scenes written to disk, for the tests of the loaders.

    use std::fs;
    use std::path::{Path, PathBuf};

    use glam::DVec3;
    use serde_json::{Value, json};
    use tempfile::TempDir;

    use crate::source::SceneSource;
    use infonerf_procedural::train_cameras;
    use infonerf_scene::{Camera, Rgba8, Scene, SceneError, SceneRequest, TestProtocol, View, ViewSelection};

    /// Returns the path of `part` in the data of ignored tests: `$INFONERF_DATA`, or a folder next to the workspace.
    pub fn shared_data(part: &str) -> PathBuf {
        let root = std::env::var_os("INFONERF_DATA")
            .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
        let path = root.join(part);
        assert!(path.is_dir(), "{part} not found; set INFONERF_DATA to the folder that holds it");
        path
    }

    pub fn request() -> SceneRequest {
        SceneRequest { train: ViewSelection::All, test: TestProtocol::All, ..Default::default() }
    }

    pub fn load(dir: &Path, request: &SceneRequest) -> Result<Scene, SceneError> {
        crate::load(&SceneSource::Folder { path: dir.into() }, request)
    }

    pub fn message(dir: &Path, request: &SceneRequest) -> String {
        let text = load(dir, request).expect_err("should be refused").to_string();
        assert!(!text.contains('\n'), "{text}");
        text
    }

    /// Asserts that the warning `index` of a scene contains `part`.
    pub fn assert_warns(scene: &Scene, index: usize, part: &str) {
        let warning = scene.warnings.get(index);
        assert!(warning.is_some_and(|warning| warning.contains(part)), "{part}: {:?}", scene.warnings);
    }

    /// Renders `knot` through `camera` and writes a PNG.
    pub fn write_view(path: &Path, camera: &Camera) {
        infonerf_procedural::render("knot", camera).unwrap().rgba.write_png(path).unwrap();
    }

    /// Asserts that the cameras have the same rays up to 1e-5.
    pub fn assert_same_rays(found: &Camera, camera: &Camera) {
        assert_eq!((found.width, found.height), (camera.width, camera.height));
        for y in 0..=camera.height {
            for x in 0..=camera.width {
                let (a, b) = (found.ray(x as f32, y as f32), camera.ray(x as f32, y as f32));
                assert!((a.direction - b.direction).length() < 1e-5, "{a:?} {b:?}");
                assert!((a.origin - b.origin).length() < 1e-5, "{a:?} {b:?}");
            }
        }
    }

    /// Asserts that the view has the rays of `camera` up to 1e-5, and the pixels of [`write_view`].
    pub fn assert_same_view(view: &View, camera: &Camera) {
        assert_same_rays(&view.camera, camera);
        let expected = infonerf_procedural::render("knot", camera).unwrap().rgba.to_f32().composite([1.0; 3]);
        assert_eq!(*view.image, expected);
    }

    /// Returns a camera whose position is that of `camera` changed by `by`.
    pub fn moved(camera: &Camera, by: impl Fn(DVec3) -> DVec3) -> Camera {
        let mut pose = camera.to_world;
        pose.w_axis = by(camera.position_f64()).extend(1.0);
        camera.with_pose(pose)
    }

    /// Writes the photographs that `cameras` take of `knot`, on white, with a `transforms.json` of their sizes and poses.
    pub fn photographs(cameras: &[Camera]) -> TempDir {
        photographs_of("knot", cameras, cameras, |i| format!("images/p{i:02}.png"))
    }

    /// Writes the photographs that `cameras` take of a scene, on white, with a `transforms.json` of `stated` cameras.
    pub fn photographs_of(scene: &str, cameras: &[Camera], stated: &[Camera], name: fn(usize) -> String) -> TempDir {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        fs::create_dir_all(dir.join("images")).unwrap();
        let frames = cameras.iter().zip(stated).enumerate().map(|(i, (taken, camera))| {
            let image = infonerf_procedural::render(scene, taken).unwrap().rgba.to_f32().composite([1.0; 3]);
            image.write_png(&dir.join(name(i))).unwrap();
            json!({"file_path": name(i), "w": camera.width, "h": camera.height,
                "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
                "transform_matrix": camera.to_world.transpose().to_cols_array_2d()})
        });
        write_json(&dir.join("transforms.json"), &json!({"frames": frames.collect::<Vec<_>>()}));
        guard
    }

    /// Returns a 4×4 pose as JSON rows.
    pub fn pose(index: usize) -> Value {
        json!(train_cameras(8)[index].to_world.transpose().to_cols_array_2d())
    }

    pub fn write_json(path: &Path, value: &Value) {
        fs::write(path, value.to_string()).unwrap();
    }

    /// Returns a `size`² image with every pixel different.
    pub fn image(size: u32, salt: u8) -> Rgba8 {
        let pixels = (0..size * size)
            .map(|i| [i as u8, (i / 3) as u8 ^ salt, salt, if i % 4 == 0 { 0 } else { 255 - i as u8 }])
            .collect();
        Rgba8 { width: size, height: size, pixels }
    }

    /// Writes a mask of `width × height` pixels, white where `is_white` is true of a pixel's index.
    pub fn write_mask(path: &Path, size: (u32, u32), is_white: impl Fn(u32) -> bool) {
        crate::files::write_mask(path, size, is_white).unwrap();
    }

    /// Writes `count` images of 8×8 pixels, `folder/r_0.png` and so on, and returns their entries of `frames`.
    pub fn frames(dir: &Path, folder: &str, count: usize, salt: u8) -> Vec<Value> {
        fs::create_dir_all(dir.join(folder)).unwrap();
        let frame = |i: usize| {
            let file = format!("{folder}/r_{i}.png");
            image(8, salt + i as u8).write_png(&dir.join(&file)).unwrap();
            json!({"file_path": file, "transform_matrix": pose(i)})
        };
        (0..count).map(frame).collect()
    }

    /// Writes a Blender folder with `train` and `test` views of 8×8 pixels.
    pub fn blender(dir: &Path, train: usize, test: usize) {
        for (split, count, salt) in [("train", train, 0), ("test", test, 100)] {
            let mut frames = frames(dir, split, count, salt);
            frames.iter_mut().for_each(|frame| {
                let path = frame["file_path"].as_str().unwrap().replace(".png", "");
                frame["file_path"] = json!(format!("./{path}"));
            });
            let value = json!({"camera_angle_x": 0.6911112, "frames": frames});
            write_json(&dir.join(format!("transforms_{split}.json")), &value);
        }
    }

    /// Adds an EXIF segment with `orientation` to a JPEG, directly after its first marker.
    pub fn set_orientation(path: &Path, orientation: u8) {
        let mut bytes = fs::read(path).unwrap();
        let mut segment = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        segment.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        bytes.splice(2..2, segment);
        fs::write(path, bytes).unwrap();
    }

    /// Changes the JSON value at `pointer` of a file; `None` removes it.
    pub fn edit(path: &Path, pointer: &str, value: Option<Value>) {
        let mut root: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match (root.pointer_mut(parent).unwrap(), value) {
            (Value::Object(map), Some(value)) => drop(map.insert(key.into(), value)),
            (Value::Object(map), None) => drop(map.remove(key)),
            (Value::Array(items), Some(value)) => items[key.parse::<usize>().unwrap()] = value,
            (Value::Array(items), None) => drop(items.remove(key.parse().unwrap())),
            _ => panic!("no such place: {pointer}"),
        }
        write_json(path, &root);
    }
}

#[cfg(test)]
mod tests {
    use super::testing::*;
    use infonerf_scene::{Format, SceneRequest};
    use std::path::Path;

    #[test]
    fn missing_and_unknown_folders() {
        let text = message(Path::new("no/such/folder"), &request());
        assert!(text.starts_with("no/such/folder: not found; expected the folder"), "{text}");
        let dir = tempfile::tempdir().unwrap();
        let text = message(dir.path(), &request());
        assert!(text.contains("expected a scene folder with one of transforms_train.json, transforms.json,"), "{text}");
        assert!(text.ends_with(": it is empty"), "{text}");
        let inner = dir.path().join("a/scan");
        blender(&inner, 2, 1);
        std::fs::write(inner.join("a.mov"), "").unwrap();
        let nested = format!("a scene is in {}; give that folder", inner.display());
        for (path, reason) in
            [("", &*nested), ("a/scan/transforms_test.json", "a file;"), ("a/scan/a.mov", "frames of")]
        {
            let text = message(&dir.path().join(path), &request());
            assert!(text.contains("expected the folder of a scene: ") && text.contains(reason), "{text}");
        }
        std::fs::create_dir_all(dir.path().join("keyframes/corrected_cameras")).unwrap();
        assert!(message(dir.path(), &request()).ends_with("nerfstudio's `ns-process-data polycam` converts it"));
        image(8, 0).write_png(&dir.path().join("a.png")).unwrap();
        let text = message(dir.path(), &request());
        let advice = format!("these are photographs: `infonerf capture {}`", dir.path().display());
        assert!(text.contains(&advice), "{text}");
    }

    /// Checks that a broken file of another format is passed over, and that either format can be requested.
    #[test]
    fn the_format_that_fits_is_read() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("toy");
        blender(&dir, 3, 2);
        std::fs::write(dir.join("transforms_train.json"), "{}").unwrap();
        assert!(message(&dir, &request()).contains("transforms_train.json: field `frames`"));
        std::fs::copy(dir.join("transforms_test.json"), dir.join("transforms.json")).unwrap();
        let scene = load(&dir, &request()).unwrap();
        assert_eq!(scene.format, Format::Transforms);
        assert_warns(&scene, 0, "read as transforms.json: as Blender it is broken: ");
        let asked = |format| SceneRequest { format: Some(format), ..request() };
        assert_eq!(load(&dir, &asked(Format::Transforms)).unwrap().warnings.len(), 0);
        assert!(message(&dir, &asked(Format::Blender)).contains("field `frames`"));
        let text = message(&dir, &asked(Format::Llff));
        assert!(text.ends_with("expected a scene folder with one of poses_bounds.npy: it has none of them"), "{text}");
    }
}
