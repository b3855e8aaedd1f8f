//! Loaders of scenes in folders. A new format is one new file and one line in [`FORMATS`].

mod assemble;
mod blender;
mod colmap;
mod depth;
mod dtu;
mod extent;
mod frames;
pub mod fuzzing;
mod json;
mod llff;
mod mask;
mod nerfstudio;
mod npy;
mod npz;
mod optics;
mod pickle;
mod pose;
mod zju;

pub(crate) use assemble::scene_name;
pub(crate) use depth::write_depth;
pub(crate) use extent::grid;
pub(crate) use frames::Frame;
pub(crate) use json::{JsonFile, Node};
pub(crate) use llff::list_images;
pub(crate) use npy::{encode as encode_npy, write as write_npy};

pub(crate) use pose::read_flat_pose;

use std::path::Path;

use infonerf_scene::{Format, PixelCount, Scene, SceneError, SceneRequest};

use crate::photographs::unposed;
pub(crate) use assemble::Parts;
use assemble::assemble;

/// A known format: the file that marks a folder as being in it, whether a folder has it, and what reads the folder.
struct Known {
    format: Format,
    marker: &'static str,
    found: fn(&Path) -> bool,
    parts: Reader,
}

type Reader = for<'a> fn(&'a Path, &SceneRequest) -> Result<Parts<'a>, SceneError>;

impl Known {
    const fn new(format: Format, marker: &'static str, found: fn(&Path) -> bool, parts: Reader) -> Self {
        Self { format, marker, found, parts }
    }
}

/// The known formats, in the order in which they are looked for.
const FORMATS: [Known; 6] = [
    Known::new(Format::Blender, blender::MARKER, |dir| dir.join(blender::MARKER).is_file(), blender::parts),
    Known::new(Format::Transforms, nerfstudio::MARKER, |dir| dir.join(nerfstudio::MARKER).is_file(), nerfstudio::parts),
    Known::new(Format::Llff, llff::MARKER, |dir| dir.join(llff::MARKER).is_file(), llff::parts),
    Known::new(Format::Dtu, dtu::MARKER, |dir| dtu::cameras_file(dir).is_some(), dtu::parts),
    Known::new(Format::Zju, zju::MARKER, |dir| dir.join(zju::MARKER).is_file(), zju::parts),
    Known::new(Format::Colmap, colmap::MARKER, |dir| crate::colmap::find(dir).is_some(), colmap::parts),
];

/// Whether the folder `dir` is in a known format.
pub(crate) fn is_scene(dir: &Path) -> bool {
    FORMATS.iter().any(|format| (format.found)(dir))
}

/// Whether the folder `dir` comes with a body.
pub(crate) fn has_body(dir: &Path) -> bool {
    zju::has_body(dir)
}

/// Loads the folder `dir` with the loader of the format whose file it holds.
pub(crate) fn load(dir: &Path, request: &SceneRequest) -> Result<Scene, SceneError> {
    assemble(parts(dir, request)?, request)
}

/// How many pixels [`load`] would hold, with no image decoded.
pub(crate) fn count_pixels(dir: &Path, request: &SceneRequest) -> Result<PixelCount, SceneError> {
    assemble::count_pixels(&parts(dir, request)?, request)
}

/// What the folder `dir` says, with no image decoded: in the format asked for, else in the first of the known ones that it
/// fits, with a warning for each before that it has the file of.
///
/// # Errors
/// That of the first format whose file it has.
pub(crate) fn parts<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Parts<'a>, SceneError> {
    request.check()?;
    let missing = |expected: String| SceneError::NotFound { path: dir.into(), expected };
    if !dir.is_dir() {
        return Err(missing("the folder of a scene".into()));
    }
    let is_asked_for = |known: &&Known| request.format.is_none_or(|format| format == known.format);
    let asked: Vec<&Known> = FORMATS.iter().filter(is_asked_for).collect();
    let mut faults = Vec::new();
    for known in asked.iter().filter(|known| (known.found)(dir)) {
        match (known.parts)(dir, request) {
            Ok(mut parts) => {
                let fault = |(format, error): &(Format, SceneError)| {
                    format!("read as {}: as {format} it is broken: {error}", known.format)
                };
                parts.warnings.extend(faults.iter().map(fault));
                return Ok(parts);
            }
            Err(error) => faults.push((known.format, error)),
        }
    }
    if !faults.is_empty() {
        return Err(faults.swap_remove(0).1);
    }
    let markers = asked.iter().map(|known| known.marker).collect::<Vec<_>>().join(", ");
    Err(unposed(dir).unwrap_or_else(|| missing(format!("a scene folder with one of {markers}"))))
}

#[cfg(test)]
pub(crate) mod testing {
    //! Small scenes written to disk, for the tests of the loaders.

    use std::fs;
    use std::path::{Path, PathBuf};

    use serde_json::{Value, json};

    use crate::SceneSource;
    use infonerf_procedural::train_cameras;
    use infonerf_scene::{Camera, Rgba8, Scene, SceneError, SceneRequest, TestProtocol, View, ViewSelection};

    /// The shared test data: `$INFONERF_DATA`, or a folder beside the workspace. Only for tests that are ignored.
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

    /// What `knot` shows to a camera, as a PNG.
    pub fn write_view(path: &Path, camera: &Camera) {
        infonerf_procedural::render("knot", camera).unwrap().rgba.write_png(path).unwrap();
    }

    /// The cameras have the same rays to 1e-5.
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

    /// The view has the rays of `camera` to 1e-5 and shows just what [`write_view`] wrote.
    pub fn assert_same_view(view: &View, camera: &Camera) {
        assert_same_rays(&view.camera, camera);
        let expected = infonerf_procedural::render("knot", camera).unwrap().rgba.to_f32().composite([1.0; 3]);
        assert_eq!(*view.image, expected);
    }

    /// A 4×4 pose as JSON rows.
    pub fn pose(index: usize) -> Value {
        let m = train_cameras(8)[index].to_world.transpose().to_cols_array_2d();
        json!(m)
    }

    pub fn write_json(path: &Path, value: &Value) {
        fs::write(path, value.to_string()).unwrap();
    }

    /// A `size`² image with every pixel different.
    pub fn image(size: u32, salt: u8) -> Rgba8 {
        let pixels = (0..size * size)
            .map(|i| [i as u8, (i / 3) as u8 ^ salt, salt, if i % 4 == 0 { 0 } else { 255 - i as u8 }])
            .collect();
        Rgba8 { width: size, height: size, pixels }
    }

    /// A Blender folder with `train` and `test` views of 8×8 pixels.
    pub fn blender(dir: &Path, train: usize, test: usize) {
        for (split, count) in [("train", train), ("test", test)] {
            fs::create_dir_all(dir.join(split)).unwrap();
            let frames: Vec<_> = (0..count)
                .map(|i| {
                    image(8, i as u8).write_png(&dir.join(format!("{split}/r_{i}.png"))).unwrap();
                    json!({"file_path": format!("./{split}/r_{i}"), "transform_matrix": pose(i)})
                })
                .collect();
            let value = json!({"camera_angle_x": 0.6911112, "frames": frames});
            write_json(&dir.join(format!("transforms_{split}.json")), &value);
        }
    }

    /// Changes the JSON value at `pointer` of a file; `None` removes it.
    pub fn edit(path: &Path, pointer: &str, value: Option<Value>) {
        let mut root: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = root.pointer_mut(parent).unwrap();
        match (parent, value) {
            (Value::Object(map), Some(value)) => {
                map.insert(key.into(), value);
            }
            (Value::Object(map), None) => {
                map.remove(key);
            }
            (Value::Array(items), Some(value)) => items[key.parse::<usize>().unwrap()] = value,
            (Value::Array(items), None) => {
                items.remove(key.parse().unwrap());
            }
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
        assert!(text.contains("transforms_train.json, transforms.json, poses_bounds.npy"), "{text}");
        image(8, 0).write_png(&dir.path().join("a.png")).unwrap();
        let text = message(dir.path(), &request());
        let advice = format!("these are photographs: `infonerf scene from-images {}`", dir.path().display());
        assert!(text.contains(&advice), "{text}");
    }

    /// A stray file of another format does not get in the way, and either can be asked for.
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
        assert!(
            scene.warnings[0].starts_with("read as transforms.json: as Blender it is broken: "),
            "{:?}",
            scene.warnings
        );
        let asked = |format| SceneRequest { format: Some(format), ..request() };
        assert_eq!(load(&dir, &asked(Format::Transforms)).unwrap().warnings.len(), 0);
        assert!(message(&dir, &asked(Format::Blender)).contains("field `frames`"));
        assert!(message(&dir, &asked(Format::Llff)).contains("expected a scene folder with one of poses_bounds.npy"));
    }
}
