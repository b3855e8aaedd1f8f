//! ZJU-MoCap: a person in 23 cameras, `annots.npy` with calibration and the images of each frame.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3, Vec3};
use infonerf_scene::image::stored_dimensions;
use infonerf_scene::{Aabb, Body, Camera, Format, Layout, Lens, SceneError, SceneRequest, Space};

use super::pose;
use crate::capture::{Found, StatedExtent, capture_space, read_mask};
use crate::colmap::opengl;
use crate::files::pickle::{Pickle, Value};
use crate::files::{PIXELS, npy, read_file};
use crate::frame::{Frame, MaskRole};

pub(crate) const MARKER: &str = "annots.npy";
const EXPECTED: &str = "a pickled dictionary with `cams` and `ims`";
/// Max size of a file in bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Folders of masks; the first that exists is read.
const MASKS: [&str; 2] = ["mask_cihp", "mask"];
/// Folders of the body's vertices and of its fitted pose; the first pair that exists is read.
const BODIES: [[&str; 2]; 2] = [["new_vertices", "new_params"], ["vertices", "params"]];
/// The published training cameras.
const TRAIN: [usize; 4] = [0, 6, 12, 18];
/// Translations are in millimetres.
const MILLIMETRES: f64 = 1000.0;
/// Margin of the box around the body in metres.
const MARGIN: f32 = 0.05;
/// Number of grid points along each side for carving the visual hull of the masks.
const CARVED: usize = 48;

/// Reads one frame of a film: `request.frame`, or the first one by default.
///
/// Images keep their distortion, which the lens describes. Outside the person's mask they are black, the scene's
/// background. The box holds the body's vertices with a margin of 5 cm, or without a body the visual hull of the
/// published training cameras' masks. Views have their cameras' numbers; all but 0, 6, 12, 18 are the test split.
pub(super) fn read<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Found<'a>, SceneError> {
    let path = dir.join(MARKER);
    let bytes = read_file(&path, EXPECTED, MAX_BYTES)?;
    let Annotations { cameras, images, frames: count } = annotations(&path, &bytes, request.frame.unwrap_or(0))?;
    let size = images.first().map(|first| stored_dimensions(&dir.join(first))).transpose()?.unwrap_or((1, 1));
    let Some(folder) = MASKS.iter().map(|m| dir.join(m)).find(|m| m.is_dir()) else {
        let expected = "the folder of the person's masks".into();
        return Err(SceneError::NotFound { path: dir.join(MASKS[0]), expected });
    };
    let frame = |(id, (name, camera)): (usize, (&String, &Camera))| {
        let camera = Camera { width: size.0, height: size.1, ..camera.clone() };
        let mask = Some((folder.join(name).with_extension("png"), MaskRole::Matte));
        Frame { id, mask, ..Frame::new(name, dir.join(name), &camera) }
    };
    let frames: Vec<Frame> = images.iter().zip(&cameras).enumerate().map(frame).collect();
    let ids: Vec<usize> = TRAIN.iter().copied().filter(|&i| i < frames.len()).collect();
    let space = space(dir, &frames, &ids, request.frame.unwrap_or(0))?;
    let others: Vec<usize> = (0..frames.len()).filter(|i| !TRAIN.contains(i)).collect();
    let mut found = Found::new(dir, Format::Zju, frames.clone(), frames, StatedExtent::Known(Box::new(space)));
    found.background = Some([0.0; 3]);
    found.selections = vec![("infonerf-4".into(), ids)];
    found.protocols = ["infonerf", "neural-body"].map(|name| (name.to_owned(), others.clone())).to_vec();
    found.split = Some(others);
    if count > 1 && request.frame.is_none() {
        found.warnings.push(format!("a film of {count} frames: the first is loaded"));
    }
    Ok(found)
}

/// Returns the folders of the body's vertices and poses, if it has any.
fn body_folders(dir: &Path) -> Option<[PathBuf; 2]> {
    let folders = BODIES.map(|folders| folders.map(|folder| dir.join(folder)));
    folders.into_iter().find(|[vertices, _]| vertices.is_dir())
}

/// Whether the folder `dir` is in this format and has a body.
pub(crate) fn has_body(dir: &Path) -> bool {
    dir.join(MARKER).is_file() && body_folders(dir).is_some()
}

/// Derives the space of a frame from the body and the cameras `train` about it.
fn space(dir: &Path, frames: &[Frame], train: &[usize], frame: usize) -> Result<Space, SceneError> {
    let cameras: Vec<Camera> = frames.iter().map(Frame::nominal_camera).collect();
    let read_body = |[folder, poses]: [PathBuf; 2]| {
        // Some films count from 1.
        let first = if folder.join("0.npy").is_file() { 0 } else { 1 };
        let file = format!("{}.npy", frame + first);
        body(&folder.join(&file), Some(poses.join(&file)).filter(|pose| pose.is_file()).as_deref())
    };
    let body = body_folders(dir).map(read_body).transpose()?;
    let bounds = match body.as_ref().and_then(|body| Aabb::containing(body.vertices.iter().copied())) {
        Some(Aabb { min, max }) => Aabb { min: min - MARGIN, max: max + MARGIN },
        None => carve(frames, &cameras, train)?,
    };
    let corner = 0.5 * bounds.size().length();
    let cameras: Vec<Camera> = train.iter().filter_map(|&i| cameras.get(i).cloned()).collect();
    let distances = cameras.iter().map(|c| c.position().distance(bounds.centre()));
    let (nearest, farthest) = distances.fold((f32::INFINITY, 0f32), |(a, b), d| (a.min(d), b.max(d)));
    let near = (nearest - corner).max(0.02 * farthest);
    let points = body.iter().flat_map(|body| body.vertices.iter().copied()).collect();
    let space = Space::known(&cameras, (near, farthest + corner), bounds);
    Ok(Space { layout: Layout::Object, points, body, ..space })
}

/// Reads a body's vertices, [n, 3] in metres, and its `pose`: the rotation `Rh` (axis times angle) and the translation
/// `Th` of its frame in the world. Without `pose` its frame is the world's.
fn body(path: &Path, pose: Option<&Path>) -> Result<Body, SceneError> {
    let expected = "finite vertices of shape [n, 3]";
    let array = npy::read(path, expected)?;
    if array.shape.len() != 2 || array.shape[1] != 3 {
        return Err(SceneError::malformed(path, expected, format!("shape {:?}", array.shape)));
    }
    let vertices: Vec<Vec3> = array.values.chunks_exact(3).map(|p| DVec3::new(p[0], p[1], p[2]).as_vec3()).collect();
    if vertices.is_empty() || !vertices.iter().all(|vertex| vertex.is_finite()) {
        return Err(SceneError::malformed(path, expected, "none, or one that is not finite"));
    }
    let Some(pose) = pose else { return Ok(Body::unposed(vertices)) };
    let expected = "a pickled dictionary with `Rh` and `Th`";
    let pickle = pickled(pose, &read_file(pose, expected, MAX_BYTES)?, expected)?;
    let vector = |key: &str| {
        let numbers = pickle.get(pickle.root(), key).and_then(|value| pickle.numbers(value));
        if let Some(&[x, y, z]) = numbers.as_deref().filter(|found| found.iter().all(|v| v.abs() <= 1e6)) {
            return Ok(DVec3::new(x, y, z));
        }
        let found = numbers.map_or("none".into(), |found| format!("{found:?}"));
        Err(SceneError::field(pose, key, "three numbers of at most 1e6", found))
    };
    let (rotation, origin) = (vector("Rh")?, vector("Th")?.as_vec3());
    let about = |axis| DMat3::from_axis_angle(axis, rotation.length());
    Ok(Body { vertices, axes: rotation.try_normalize().map_or(DMat3::IDENTITY, about).as_mat3(), origin })
}

/// Returns the box of the grid points that project into the person in the masks of all training cameras.
fn carve(frames: &[Frame], cameras: &[Camera], train: &[usize]) -> Result<Aabb, SceneError> {
    let about = capture_space(cameras, Vec::new(), Vec::new());
    let mut masks = Vec::new();
    for (frame, camera) in train.iter().filter_map(|&i| frames.get(i).zip(cameras.get(i))) {
        let Some(mask) = &frame.mask else { continue };
        let mask = read_mask(&frame.image, mask, (camera.width, camera.height), true)?;
        // A view without the person does not constrain the hull.
        if mask.contains(&true) {
            masks.push((camera, mask));
        }
    }
    let shows = |camera: &Camera, mask: &[bool], p: Vec3| {
        let Some(pixel) = camera.project(p) else { return false };
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < camera.width as f32;
        inside && mask.get(pixel.y as usize * camera.width as usize + pixel.x as usize) == Some(&true)
    };
    let seen = |p: Vec3| masks.iter().all(|(camera, mask)| shows(camera, mask, p));
    // Two passes: over the cube that the cameras surround, then over the box of the first pass.
    let mut bounds = Aabb::cube(about.centre, about.radius);
    for _ in 0..2 {
        let step = bounds.size() / CARVED as f32;
        let centre = |i: usize| {
            let cell = Vec3::new((i % CARVED) as f32, (i / CARVED % CARVED) as f32, (i / CARVED / CARVED) as f32);
            bounds.min + (cell + 0.5) * step
        };
        match Aabb::containing((0..CARVED.pow(3)).map(centre).filter(|&p| seen(p))) {
            Some(Aabb { min, max }) => bounds = Aabb { min: min - step, max: max + step },
            None => return Ok(about.bounds),
        }
    }
    Ok(Aabb { min: bounds.min - MARGIN, max: bounds.max + MARGIN })
}

/// Contents of `annots.npy` for one frame.
pub(crate) struct Annotations {
    /// Cameras; their image size is not part of the file.
    pub cameras: Vec<Camera>,
    /// Images of the frame, one for each camera.
    pub images: Vec<String>,
    /// Number of frames.
    pub frames: usize,
}

pub(crate) fn annotations(path: &Path, bytes: &[u8], frame: usize) -> Result<Annotations, SceneError> {
    let pickle = pickled(path, bytes, EXPECTED)?;
    let field =
        |name: &str, expected: &str, found: &dyn std::fmt::Display| SceneError::field(path, name, expected, found);
    let get = |value: &Value, key: &str, place: &str| {
        pickle.get(value, key).ok_or_else(|| field(place, "an entry of a dictionary", &"nothing"))
    };
    let items = |value: &Value, place: &str| {
        let items = pickle.items(value).filter(|items| !items.is_empty());
        items.ok_or_else(|| field(place, "a list", &"something else, or nothing in it"))
    };
    let ims = items(get(pickle.root(), "ims", "ims")?, "ims")?;
    let Some(chosen) = ims.get(frame) else {
        return Err(SceneError::request("frame", format!("a frame from 0 to {}", ims.len() - 1), frame));
    };
    let place = format!("ims[{frame}].ims");
    let images = items(get(chosen, "ims", &place)?, &place)?;
    let name = |value: &Value| pickle.text(value).filter(|t| !t.is_empty()).map(|t| t.replace('\\', "/"));
    let images: Option<Vec<String>> = images.iter().map(name).collect();
    let images = images.ok_or_else(|| field(&place, "paths of images", &"something else"))?;
    let cams = get(pickle.root(), "cams", "cams")?;
    let [k, d, r, t] = ["K", "D", "R", "T"].map(|key| {
        let place = format!("cams.{key}");
        let list = items(get(cams, key, &place)?, &place)?;
        let expected = format!("one entry for each of {} images", images.len());
        if list.len() == images.len() { Ok(list) } else { Err(field(&place, &expected, &list.len())) }
    });
    let (k, d, r, t) = (k?, d?, r?, t?);
    let cameras = k.iter().zip(d).zip(r).zip(t).enumerate();
    let cameras = cameras.map(|(i, (((k, d), r), t))| camera(path, &pickle, i, [k, d, r, t]));
    Ok(Annotations { cameras: cameras.collect::<Result<_, _>>()?, images, frames: ims.len() })
}

/// Returns the object in a `.npy` file of objects.
fn pickled(path: &Path, bytes: &[u8], expected: &str) -> Result<Pickle, SceneError> {
    let fault = |reason: &dyn std::fmt::Display| SceneError::malformed(path, expected, reason);
    let Some((header, data)) = npy::split(bytes) else { return Err(fault(&"no header of an array")) };
    if !npy::entry(header, "descr").is_some_and(|kind| kind.starts_with("'|O'")) {
        return Err(fault(&"an array of something else than objects"));
    }
    Pickle::read(data).map_err(|e| fault(&e))
}

/// Makes camera `index` from K, D (k₁ k₂ p₁ p₂ k₃, then k₄ k₅ k₆), R (world to camera) and T (millimetres).
fn camera(path: &Path, pickle: &Pickle, index: usize, [k, d, r, t]: [&Value; 4]) -> Result<Camera, SceneError> {
    let fault = |key: &str, expected: &str, found: &dyn std::fmt::Display| {
        SceneError::field(path, format!("cams.{key}[{index}]"), expected, found)
    };
    let numbers = |value: &Value, key: &str, expected: &str, counts: RangeInclusive<usize>| {
        let numbers = pickle.numbers(value).ok_or_else(|| fault(key, expected, &"something else"))?;
        if !counts.contains(&numbers.len()) {
            return Err(fault(key, expected, &format!("{} numbers", numbers.len())));
        }
        if !numbers.iter().all(|v| v.abs() <= 1e9) {
            return Err(fault(key, expected, &"a value that is not finite"));
        }
        Ok(numbers)
    };
    let k = numbers(k, "K", "a 3×3 matrix", 9..=9)?;
    let d = numbers(d, "D", "4 to 8 distortion coefficients", 4..=8)?;
    let r = numbers(r, "R", "a 3×3 rotation", 9..=9)?;
    let t = numbers(t, "T", "3 coordinates", 3..=3)?;
    let (fx, fy) = (k[0], k[4]);
    if ![fx, fy].iter().all(|f| PIXELS.contains(f)) {
        return Err(fault("K", "positive focal lengths", &format!("{fx} and {fy}")));
    }
    let rows = |i: usize| DVec3::new(r[i], r[i + 1], r[i + 2]);
    // The rows of R, which takes world to camera, are the camera's axes.
    let axes = DMat3::from_cols(rows(0), rows(3), rows(6));
    let pose = opengl(axes, -(axes * DVec3::new(t[0], t[1], t[2])) / MILLIMETRES);
    if let Some(found) = pose::fault(&pose) {
        return Err(fault("R", "a 3×3 rotation", &found));
    }
    let c = |i: usize| d.get(i).copied().unwrap_or(0.0);
    let lens = Lens::rational([c(0), c(1), c(4), c(5), c(6), c(7)], [c(2), c(3)]);
    // In K pixel centres are whole numbers.
    Ok(Camera::pinhole((1, 1), [fx, fy], [k[2] + 0.5, k[5] + 0.5], pose).with_lens(lens))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::super::testing::*;
    use super::*;
    use crate::export::{annotations, lens};
    use crate::files::pickle::{dict, npy as npy_of, numbers, object, text};
    use glam::DMat4;
    use infonerf_procedural::train_cameras;
    use infonerf_scene::{Backdrop, Rgba8, TestProtocol};

    fn write(path: &Path, pickle: &[u8]) {
        fs::write(path, npy_of(pickle)).unwrap();
    }

    fn folder(dir: &Path) -> Vec<Camera> {
        let lens = Camera::pinhole((20, 20), [27.0, 27.5], [10.25, 9.75], DMat4::IDENTITY).with_lens(lens());
        let cameras: Vec<Camera> = train_cameras(8)[..8].iter().map(|c| lens.with_pose(c.to_world)).collect();
        write(&dir.join(MARKER), &annotations(&cameras, 2));
        for (i, camera) in cameras.iter().enumerate() {
            fs::create_dir_all(dir.join(format!("Camera_B{i}"))).unwrap();
            fs::create_dir_all(dir.join(format!("mask_cihp/Camera_B{i}"))).unwrap();
            let mut shown = infonerf_procedural::render("knot", camera).unwrap().rgba;
            let person = |p: &[u8; 4]| if p[3] > 127 { [1, 1, 1, 255] } else { [0, 0, 0, 255] };
            let mask = Rgba8 { pixels: shown.pixels.iter().map(person).collect(), ..shown.clone() };
            mask.write_png(&dir.join(format!("mask_cihp/Camera_B{i}/000001.png"))).unwrap();
            shown.pixels.iter_mut().for_each(|p| p[3] = 255);
            shown.write_png(&dir.join(format!("Camera_B{i}/000001.png"))).unwrap();
        }
        cameras
    }

    fn second() -> SceneRequest {
        SceneRequest { train: "infonerf-4".parse().unwrap(), test: TestProtocol::Split, frame: Some(1), ..request() }
    }

    #[test]
    fn a_procedural_scene_round_trips() {
        let guard = tempfile::tempdir().unwrap();
        let cameras = folder(guard.path());
        let scene = load(guard.path(), &second()).unwrap();
        assert_eq!(scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), [0, 6]);
        assert_eq!(scene.test.iter().map(|v| v.id).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 7]);
        let of_training: Vec<&Camera> = scene.train.iter().map(|view| &view.camera).collect();
        assert_eq!(scene.all_train_cameras.iter().collect::<Vec<_>>(), of_training, "no pose of a test view is known");
        for view in scene.train.iter().chain(&scene.test) {
            assert_same_rays(&view.camera, &cameras[view.id]);
            let shown = infonerf_procedural::render("knot", &cameras[view.id]).unwrap().rgba;
            let mask = view.mask.as_deref().unwrap();
            for (i, pixel) in shown.pixels.iter().enumerate() {
                assert_eq!(mask[i], pixel[3] > 127);
                let expected = if mask[i] { [0, 1, 2].map(|c| f32::from(pixel[c]) / 255.0) } else { [0.0; 3] };
                assert_eq!(view.image.rgb[i], expected);
            }
        }
        assert_eq!((scene.format, scene.background, scene.backdrop), (Format::Zju, [0.0; 3], Backdrop::Colour));
        assert!(scene.space.bounded && scene.space.bounds.size().max_element() < 4.0, "{:?}", scene.space.bounds);
        assert!(scene.space.bounds.contains(Vec3::ZERO) && scene.space.near > 1.0 && scene.space.far < 8.0);
        // A body gives the box.
        fs::create_dir(guard.path().join("new_vertices")).unwrap();
        let body = guard.path().join("new_vertices/2.npy");
        npy::write(&body, &[2, 3], &[-1.0, -1.0, 0.0, 1.0, 0.5, 1.5]).unwrap();
        let scene = load(guard.path(), &second()).unwrap();
        assert!((scene.space.bounds.max - Vec3::new(1.05, 0.55, 1.55)).length() < 1e-6);
        let vertices = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 0.5, 1.5)];
        assert_eq!(scene.space.body, Some(Body::unposed(vertices)));
        // The pose of a body: a quarter turn about z.
        fs::create_dir(guard.path().join("new_params")).unwrap();
        let pose = guard.path().join("new_params/2.npy");
        let vector = |values: [f64; 3]| numbers(&[1, 3], &values);
        let of = |turn: f64| object(dict(&[("Rh", vector([0.0, 0.0, turn])), ("Th", vector([0.1, 0.2, 0.3]))]));
        write(&pose, &of(std::f64::consts::FRAC_PI_2));
        let posed = load(guard.path(), &second()).unwrap().space.body.unwrap();
        assert!((posed.axes * Vec3::X - Vec3::Y).length() < 1e-6, "{:?}", posed.axes);
        assert_eq!(posed.origin, Vec3::new(0.1, 0.2, 0.3));
        write(&pose, &of(f64::NAN));
        assert!(message(guard.path(), &second()).contains("`Rh`: expected three numbers of at most 1e6"));
        fs::remove_file(&pose).unwrap();
        npy::write(&body, &[1, 3], &[0.0, f32::NAN, 0.0]).unwrap();
        assert!(message(guard.path(), &second()).contains("finite vertices of shape [n, 3]"));
    }

    #[test]
    fn faults() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        let cameras = folder(dir);
        let path = dir.join(MARKER);
        let beyond = SceneRequest { frame: Some(2), ..second() };
        assert!(message(dir, &beyond).contains("`frame`: expected a frame from 0 to 1, found 2"));
        let whole = annotations(&cameras, 2);
        let replaced = |from: &[u8], to: &[u8]| {
            let at = whole.windows(from.len()).position(|w| w == from).unwrap();
            [&whole[..at], to, &whole[at + from.len()..]].concat()
        };
        let with = |pickle: &[u8]| {
            write(&path, pickle);
            message(dir, &second())
        };
        assert!(with(b"cos\nsystem\n(S'true'\ntR.").contains("asks for the code `os.system`; nothing of it was run"));
        assert!(with(&whole[..whole.len() / 2]).contains("it ends early"));
        assert!(with(&replaced(&text("K"), &text("Q"))).contains("field `cams.K`"));
        assert!(with(&replaced(&text("cams"), &text("cam"))).contains("field `cams`"));
        assert!(with(&replaced(&27f64.to_le_bytes(), &0f64.to_le_bytes())).contains("`cams.K[0]`: expected positive"));
        assert!(with(&object(b"N".to_vec())).contains("field `ims`"));
        let more = with(&replaced(&text("Camera_B7/000001.png"), &[]));
        assert!(more.contains("annots.npy: field `cams.K`: expected one entry for each of 7 images, found 8"));
        write(&path, &annotations(&cameras[..2], 2));
        fs::remove_file(dir.join("mask_cihp/Camera_B0/000001.png")).unwrap();
        assert!(message(dir, &second()).contains("mask_cihp/Camera_B0/000001.png: not found"));
        fs::remove_dir_all(dir.join("mask_cihp")).unwrap();
        assert!(message(dir, &second()).contains("mask_cihp: not found"));
        npy::write(&path, &[1], &[1.0]).unwrap();
        assert!(message(dir, &second()).contains("something else than objects"));
    }
}
