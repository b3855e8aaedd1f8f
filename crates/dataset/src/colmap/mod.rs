//! Reconstructions of COLMAP: cameras with their lenses, poses, points and where each image sees them.

mod camera;
pub(crate) mod read;

pub use camera::ColmapCamera;
#[cfg(test)]
use camera::MODELS;
pub(crate) use camera::lens;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use infonerf_scene::{Camera, SceneError};
use infonerf_sfm::Pose;

use crate::files::{MAX_COORDINATE, make_folder, read_file, write_file};
use read::Values;

/// Folders in a scene's folder that may contain reconstructions or numbered folders of them; the last is that folder.
const PLACES: [&str; 7] = ["sparse", "colmap/sparse", "dense/0/sparse", "dense/sparse", "distorted/sparse", "0", ""];
const MAX_BYTES: u64 = 2 << 30;
/// Max number of numbered reconstructions of a capture.
const MAX_MODELS: usize = 50;
/// Max difference of a quaternion's length from 1; values in text files are rounded.
const TOLERANCE: f64 = 1e-2;

/// One registered image.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapImage {
    /// COLMAP's number of the image.
    pub id: u32,
    /// Path below the folder of images.
    pub name: String,
    /// Number of the image's camera.
    pub camera: u32,
    /// Camera-to-world, OpenGL.
    pub pose: DMat4,
    /// Pixel positions, as [`Camera::project_f64`] gives them, and the number of the point seen there.
    pub observations: Vec<(DVec2, u64)>,
}

/// A sparse reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// Cameras by their number.
    pub cameras: BTreeMap<u32, ColmapCamera>,
    /// Registered images, sorted by name.
    pub images: Vec<ColmapImage>,
    /// Points by their number, world coordinates.
    pub points: BTreeMap<u64, DVec3>,
}

impl Reconstruction {
    /// Reads the reconstruction with most images in `dir`, or in `sparse` or another folder of COLMAP below it:
    /// `cameras.bin`, `images.bin` and `points3D.bin`, or the same as `.txt`. Without a file of points there are none.
    ///
    /// # Errors
    /// There is none, a file is missing or broken, a camera's model is unknown or its numbers are no lens, a quaternion is
    /// not of unit length, or an image's camera is not there.
    pub fn read(dir: &Path) -> Result<Self, SceneError> {
        let Some((place, _)) = models(dir).into_iter().next() else {
            let expected = "a reconstruction of COLMAP (cameras.bin or cameras.txt, there or in sparse/0)".into();
            return Err(SceneError::NotFound { path: dir.into(), expected });
        };
        Self::read_at(&place)
    }

    pub(crate) fn read_at(place: &Path) -> Result<Self, SceneError> {
        let mut read = Self {
            cameras: read_values(place, "cameras", read::cameras)?,
            images: read_values(place, "images", read::images)?,
            points: match read_values(place, "points3D", read::points) {
                Err(SceneError::NotFound { .. }) => BTreeMap::new(),
                points => points?,
            },
        };
        let images = path_of(place, "images");
        if let Some(image) = read.images.iter().find(|image| !read.cameras.contains_key(&image.camera)) {
            let field = format!("image {}", image.id);
            return Err(SceneError::field(&images, field, "the number of a camera", image.camera));
        }
        if read.images.is_empty() {
            return Err(SceneError::malformed(&images, "at least one registered image", "it has none"));
        }
        read.images.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(read)
    }

    /// Returns the camera of an image, or `None` where its number is unknown.
    pub fn camera(&self, image: &ColmapImage) -> Option<Camera> {
        self.cameras.get(&image.camera).map(|camera| camera.at(image.pose))
    }
}

/// Returns the path of a file of the reconstruction in `place`, which is binary if that of the cameras is.
pub(crate) fn path_of(place: &Path, name: &str) -> PathBuf {
    let is_binary = place.join("cameras.bin").is_file();
    place.join(name).with_extension(if is_binary { "bin" } else { "txt" })
}

fn read_values<T>(place: &Path, name: &str, read: fn(Values<'_>) -> Result<T, SceneError>) -> Result<T, SceneError> {
    let path = path_of(place, name);
    let bytes = read_file(&path, "a file of a COLMAP reconstruction", MAX_BYTES)?;
    if path.extension().is_some_and(|extension| extension == "bin") {
        return read(Values::binary(&path, &bytes)?);
    }
    read(Values::text(&path, &String::from_utf8_lossy(&bytes)))
}

/// Lists the reconstructions in the first of [`PLACES`] below `dir` that has any, with their numbers of images in
/// descending order. COLMAP's mapper writes several if it cannot join all photographs.
pub(crate) fn models(dir: &Path) -> Vec<(PathBuf, u64)> {
    let counted = |place: PathBuf| Some((place.clone(), count_images(&place)?));
    let in_place = |place: &&str| {
        let place = dir.join(place);
        let numbered = (0..MAX_MODELS).map(|i| place.join(i.to_string()));
        numbered.chain([place.clone()]).filter_map(counted).collect::<Vec<_>>()
    };
    let mut models = PLACES.iter().map(in_place).find(|models| !models.is_empty()).unwrap_or_default();
    models.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    models
}

/// Counts the images of the reconstruction in `place`, 0 if they cannot be read; `None` without a file of cameras.
fn count_images(place: &Path) -> Option<u64> {
    if place.join("cameras.bin").is_file() {
        let mut count = [0; 8];
        let read = File::open(place.join("images.bin")).and_then(|mut file| file.read_exact(&mut count));
        return Some(read.map_or(0, |()| u64::from_le_bytes(count)));
    }
    place.join("cameras.txt").is_file().then(|| {
        let text = fs::read_to_string(place.join("images.txt")).unwrap_or_default();
        text.lines().filter(|line| !line.starts_with('#')).count() as u64 / 2
    })
}

/// Returns camera-to-world in OpenGL's axes from COLMAP's world-to-camera quaternion (w, x, y, z) and translation.
fn pose(path: &Path, place: &str, [w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<DMat4, SceneError> {
    let fault = |expected: &str, found: String| SceneError::field(path, place, expected, found);
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let length = rotation.length();
    if length.is_nan() || (length - 1.0).abs() > TOLERANCE {
        return Err(fault("a quaternion of length 1", format!("length {length}")));
    }
    let turned = DMat3::from_quat(rotation.normalize()).transpose();
    let position = -(turned * DVec3::from(translation));
    if !position.is_finite() || position.abs().max_element() > MAX_COORDINATE {
        return Err(fault(&format!("a position within {MAX_COORDINATE:e} of the origin"), position.to_string()));
    }
    Ok(opengl(turned, position))
}

/// Returns the OpenGL pose at `position` of a camera whose x, y (down) and z (forward) axes are the columns of `axes`.
pub(crate) fn opengl(axes: DMat3, position: DVec3) -> DMat4 {
    let [x, y, z] = [axes.x_axis, -axes.y_axis, -axes.z_axis].map(|axis| axis.extend(0.0));
    DMat4::from_cols(x, y, z, position.extend(1.0))
}

/// Returns COLMAP's world-to-camera quaternion (w, x, y, z) and translation: the inverse of [`pose`].
fn world_to_camera(pose: &DMat4) -> ([f64; 4], [f64; 3]) {
    let Pose { rotation, translation } = Pose::of(pose);
    let q = DQuat::from_mat3(&rotation).normalize();
    ([q.w, q.x, q.y, q.z], translation.to_array())
}

// Writing in COLMAP's binary format.
impl Reconstruction {
    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` to `dir`, which it creates. `colour` returns the RGB of a point.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, dir: &Path, colour: impl Fn(u64) -> [u8; 3]) -> Result<(), SceneError> {
        make_folder(dir)?;
        write_file(&dir.join("cameras.bin"), self.encoded_cameras())?;
        write_file(&dir.join("images.bin"), self.encoded_images())?;
        write_file(&dir.join("points3D.bin"), self.encoded_points(colour))
    }

    fn encoded_cameras(&self) -> Vec<u8> {
        let mut out = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (id, camera) in &self.cameras {
            out.extend(id.to_le_bytes());
            out.extend((camera.model as i32).to_le_bytes());
            out.extend(u64::from(camera.width).to_le_bytes());
            out.extend(u64::from(camera.height).to_le_bytes());
            out.extend(numbers(&camera.parameters));
        }
        out
    }

    fn encoded_images(&self) -> Vec<u8> {
        let mut out = (self.images.len() as u64).to_le_bytes().to_vec();
        for image in &self.images {
            let (quaternion, translation) = world_to_camera(&image.pose);
            out.extend(image.id.to_le_bytes());
            out.extend(numbers(&quaternion).chain(numbers(&translation)));
            out.extend(image.camera.to_le_bytes());
            out.extend(image.name.bytes().chain([0]));
            out.extend((image.observations.len() as u64).to_le_bytes());
            for (pixel, point) in &image.observations {
                out.extend(numbers(&pixel.to_array()));
                out.extend(point.to_le_bytes());
            }
        }
        out
    }

    fn encoded_points(&self, colour: impl Fn(u64) -> [u8; 3]) -> Vec<u8> {
        // By point: its observations (image, index of the observation), and the sum of their reprojection errors in pixels.
        let mut tracks: BTreeMap<u64, (Vec<[u32; 2]>, f64)> = BTreeMap::new();
        for image in &self.images {
            let camera = self.camera(image);
            for (index, (pixel, id)) in image.observations.iter().enumerate() {
                let (track, error) = tracks.entry(*id).or_default();
                track.push([image.id, index as u32]);
                let falls = self.points.get(id).and_then(|point| camera.as_ref()?.project_f64(*point));
                *error += falls.map_or(0.0, |falls| falls.distance(*pixel));
            }
        }
        let mut out = (self.points.len() as u64).to_le_bytes().to_vec();
        for (id, position) in &self.points {
            let (track, error) = tracks.get(id).cloned().unwrap_or_default();
            out.extend(id.to_le_bytes());
            out.extend(numbers(&position.to_array()));
            out.extend(colour(*id));
            out.extend((error / track.len().max(1) as f64).to_le_bytes());
            out.extend((track.len() as u64).to_le_bytes());
            out.extend(track.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        }
        out
    }
}

fn numbers(values: &[f64]) -> impl Iterator<Item = u8> {
    values.iter().flat_map(|v| v.to_le_bytes())
}

#[cfg(test)]
pub(crate) mod testing {
    //! Reconstructions written to disk.

    use super::*;

    /// Returns a reconstruction without points, of images that one camera took.
    pub fn reconstruction(camera: ColmapCamera, taken: &[Camera], name: impl Fn(usize) -> String) -> Reconstruction {
        let image = |(i, taken): (usize, &Camera)| {
            let (id, name, pose) = (i as u32 + 1, name(i), taken.to_world);
            ColmapImage { id, name, camera: 4, pose, observations: Vec::new() }
        };
        let images = taken.iter().enumerate().map(image).collect();
        Reconstruction { cameras: [(4, camera)].into(), images, points: BTreeMap::new() }
    }

    pub fn write_binary(dir: &Path, all: &Reconstruction) {
        all.write(dir, |_| [1, 2, 3]).unwrap();
    }

    /// Writes text as several programs spell it: models in small letters, a width of 32.0, and 2⁶⁴ − 1 for no point.
    pub fn write_text(dir: &Path, all: &Reconstruction) {
        fs::create_dir_all(dir).unwrap();
        let join = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let line = |(id, c): (&u32, &ColmapCamera)| {
            format!("{id} {} {}.0 {} {}\n", MODELS[c.model].0.to_lowercase(), c.width, c.height, join(&c.parameters))
        };
        let cameras: String = all.cameras.iter().map(line).collect();
        fs::write(dir.join("cameras.txt"), format!("# Camera list\n{cameras}")).unwrap();
        let mut out = "# Image list\n".to_owned();
        for image in &all.images {
            let (q, t) = world_to_camera(&image.pose);
            out += &format!("{} {} {} {} {}\n", image.id, join(&q), join(&t), image.camera, image.name);
            let seen = image.observations.iter().map(|(p, id)| format!("{} {} {id}", p.x, p.y));
            out += &(seen.chain(["1 2 18446744073709551615 3.5 4.5 -1".into()]).collect::<Vec<_>>().join(" ") + "\n");
        }
        fs::write(dir.join("images.txt"), out).unwrap();
        let point = |(id, p): (&u64, &DVec3)| format!("{id} {} 1 2 3 0.5 1 0\n", join(&p.to_array()));
        let points: String = all.points.iter().map(point).collect();
        fs::write(dir.join("points3D.txt"), format!("# Points\n{points}")).unwrap();
    }
}

#[cfg(test)]
mod tests {
    use super::testing::*;
    use super::*;
    use infonerf_procedural::train_cameras;

    /// Returns points on a ball, seen by cameras of every model.
    fn toy() -> Reconstruction {
        let values =
            [("fx", 50.0), ("fy", 51.0), ("cx", 16.0), ("cy", 12.0), ("k1", 0.1), ("k2", 0.02), ("omega", 0.9)];
        let parameter = |name: &&str| values.iter().find(|(known, _)| known == name).map_or(1e-3, |(_, value)| *value);
        let camera = |(model, (_, names)): (usize, &(&str, &[&str]))| {
            let parameters: Vec<f64> = names.iter().map(parameter).collect();
            (model as u32 + 1, ColmapCamera::new(Path::new("toy"), "camera", model, (32, 24), parameters).unwrap())
        };
        let cameras: BTreeMap<u32, ColmapCamera> = MODELS.iter().take(10).enumerate().map(camera).collect();
        let point = |a: f64| DVec3::new((a * 0.7).sin(), (a * 1.3).cos(), (a * 0.4).sin());
        let points: BTreeMap<u64, DVec3> = (0..60).map(|i| (i * 3, point(i as f64))).collect();
        let image = |((&id, camera), Camera { to_world: pose, .. }): ((&u32, &ColmapCamera), Camera)| {
            let full = camera.at(pose);
            let see = |(&n, &p): (&u64, &DVec3)| full.project_f64(p).map(|pixel| (pixel, n));
            let (name, observations) = (format!("a  {id:02}.png"), points.iter().filter_map(see).collect());
            ColmapImage { id: id + 10, name, camera: id, pose, observations }
        };
        let images = cameras.iter().zip(train_cameras(8)).map(image).collect();
        Reconstruction { cameras, images, points }
    }

    #[test]
    fn binary_and_text_round_trip() {
        let guard = tempfile::tempdir().unwrap();
        let all = toy();
        write_binary(&guard.path().join("sparse/0"), &all);
        write_text(&guard.path().join("text"), &all);
        for dir in [guard.path().to_owned(), guard.path().join("text")] {
            let read = Reconstruction::read(&dir).unwrap();
            assert_eq!((&read.cameras, &read.points), (&all.cameras, &all.points));
            for (a, b) in read.images.iter().zip(&all.images) {
                assert!(a.pose.abs_diff_eq(b.pose, 1e-12) && a.name == b.name);
                assert_eq!(a.observations, b.observations);
            }
        }
    }

    fn fault(file: &str, change: impl Fn(&mut Vec<u8>)) -> String {
        let guard = tempfile::tempdir().unwrap();
        let write = if file.ends_with(".txt") { write_text } else { write_binary };
        write(guard.path(), &toy());
        let path = guard.path().join(file);
        let mut bytes = fs::read(&path).unwrap();
        change(&mut bytes);
        fs::write(&path, bytes).unwrap();
        let error = Reconstruction::read(guard.path()).unwrap_err().to_string();
        assert!(error.contains(file) && !error.contains('\n'), "{error}");
        error
    }

    #[test]
    fn faults_of_binary_files() {
        for file in ["cameras.bin", "images.bin", "points3D.bin"] {
            assert!(fault(file, |b| b.truncate(b.len() / 2)).contains("ends early"));
            assert!(fault(file, |b| b.truncate(3)).contains("ends early"));
            assert!(fault(file, |b| b[..8].fill(255)).contains("ends early"));
            assert!(fault(file, |b| b.push(0)).contains("more bytes"));
        }
        assert!(fault("cameras.bin", |b| b[12] = 77).contains("expected a known lens model"));
        let unsupported = "FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE), found THIN_PRISM_FISHEYE";
        assert!(fault("cameras.bin", |b| b[12] = 10).contains(unsupported));
        assert!(fault("cameras.bin", |b| b[16..24].fill(0)).contains("an image side"));
        assert!(fault("images.bin", |b| b[12..20].fill(0)).contains("quaternion of length 1"));
        assert!(fault("images.bin", |b| b[12..20].fill(255)).contains("quaternion"));
        assert!(fault("images.bin", |b| b[68] = 99).contains("the number of a camera"));
    }

    #[test]
    fn faults_of_text_files() {
        let replace = |from: &'static str, to: &'static str| {
            move |b: &mut Vec<u8>| *b = String::from_utf8(b.clone()).unwrap().replacen(from, to, 1).into_bytes()
        };
        assert!(fault("cameras.txt", replace("pinhole 32", "magic 32")).contains("line 2"));
        assert!(fault("cameras.txt", replace(" 50 16", " 50 x")).contains("line 2"));
        assert!(fault("cameras.txt", replace(" 50 16", " -50 16")).contains("positive focal length"));
        assert!(fault("cameras.txt", replace(" 50 16 12", " 50 16")).contains("too few words"));
        assert!(fault("images.txt", replace("11 ", "11 9")).contains("quaternion of length 1"));
        assert!(fault("images.txt", replace(" 3.5 4.5 -1", " 3.5 4.5")).contains("line 3"));
        assert!(fault("points3D.txt", replace(" 1 2 3", " ")).contains("line 2"));
        let guard = tempfile::tempdir().unwrap();
        let text = Reconstruction::read(guard.path()).unwrap_err().to_string();
        assert!(text.contains("expected a reconstruction of COLMAP"), "{text}");
        write_binary(guard.path(), &toy());
        fs::remove_file(guard.path().join("images.bin")).unwrap();
        assert!(Reconstruction::read(guard.path()).unwrap_err().to_string().contains("images.bin: not found"));
    }

    #[test]
    fn the_largest_model_is_read_and_needs_no_points() {
        let guard = tempfile::tempdir().unwrap();
        let whole = toy();
        let part = Reconstruction { images: whole.images[..2].to_vec(), ..whole.clone() };
        write_binary(&guard.path().join("sparse/0"), &part);
        write_text(&guard.path().join("sparse/1"), &whole);
        fs::remove_file(guard.path().join("sparse/1/points3D.txt")).unwrap();
        assert_eq!(models(guard.path()).iter().map(|(_, count)| *count).collect::<Vec<_>>(), [10, 2]);
        let read = Reconstruction::read(guard.path()).unwrap();
        assert_eq!((read.images.len(), read.points.len()), (10, 0));
        for place in ["distorted/sparse/0", "dense/0/sparse"] {
            let guard = tempfile::tempdir().unwrap();
            write_binary(&guard.path().join(place), &part);
            assert_eq!(Reconstruction::read(guard.path()).unwrap().images.len(), 2);
        }
    }
}
