//! Forward-facing captures in LLFF's format: `poses_bounds.npy` and folders of images.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec3};
use infonerf_scene::image::stored_dimensions;
use infonerf_scene::select::published;
use infonerf_scene::{Camera, Format, SceneError, SceneRequest};

use super::pose;
use crate::capture::{Found, StatedExtent, hold_out, list_photographs, same_proportions};
use crate::files::npy::{self, Array};
use crate::files::{MAX_COORDINATE, PIXELS};
use crate::frame::{Frame, numbered};

pub(crate) const MARKER: &str = "poses_bounds.npy";

/// Number of values of a view: a 3×5 matrix and two depths.
const COLUMNS: usize = 17;
pub(crate) const EXPECTED: &str = "an array [N, 17] of poses and depth bounds";
/// The nearest depth of all becomes `1 / NEAREST` after scaling.
const NEAREST: f64 = 0.75;
/// Ratio of near to the min depth.
const MARGIN: f32 = 0.9;
/// Folders that may hold the images, the largest first.
pub(super) const FOLDERS: [&str; 4] = ["images", "images_2", "images_4", "images_8"];

/// Reads a folder in LLFF's format.
///
/// Each row of `poses_bounds.npy` is a 3×5 matrix, row-major, and the depths of the nearest and farthest point seen. The
/// matrix's columns are the camera's down, right and backward axes, its position, and (height, width, focal length in pixels)
/// of the full-size images. Poses are converted to OpenGL, scaled so that the min depth becomes 4/3, and recentred on their
/// mean pose. Like LLFF's loader this uses test views too, with a warning. Views 0, 8, 16, … are held out for test. Near and
/// far are depths along the viewing axis. The box contains what training cameras see between them.
///
/// Images come from the smallest of `images`, `images_2`, `images_4`, `images_8` that is at least as
/// large as the request (without one: the largest there is), sorted by name.
pub(super) fn read<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Found<'a>, SceneError> {
    let path = dir.join(MARKER);
    let rows = rows(&path, npy::read(&path, EXPECTED)?)?;
    let images = find_images(dir, request.image_size)?;
    if images.len() != rows.len() {
        let folder = images.first().and_then(|p| p.parent()).unwrap_or(dir);
        let expected = format!("{} images, one for each pose", rows.len());
        return Err(SceneError::malformed(folder, expected, format!("it has {}", images.len())));
    }
    let (width, height) = images.first().map_or(Ok((1, 1)), |first| stored_dimensions(first))?;
    for (index, PoseRow { size: [rows, columns, _], .. }) in rows.iter().enumerate() {
        if !same_proportions((*columns as u32, *rows as u32), (width, height)) {
            let expected = format!("a height and width in the proportions of the images, {height}×{width} pixels");
            return Err(SceneError::field(&path, format!("[{index}, 4, 9]"), expected, format!("{rows}×{columns}")));
        }
    }
    let (poses, range) = scaled_and_recentred(&path, &rows)?;
    let frame = |((row, pose), image): ((&PoseRow, DMat4), &PathBuf)| {
        let [rows, columns, focal] = row.size;
        let focal = [focal * f64::from(width) / columns, focal * f64::from(height) / rows];
        let centre = [f64::from(width) / 2.0, f64::from(height) / 2.0];
        let camera = Camera::pinhole((width, height), focal, centre, pose);
        Frame::new(&image.strip_prefix(dir).unwrap_or(image).to_string_lossy(), image.clone(), &camera)
    };
    let (train, test) = hold_out(rows.iter().zip(poses).zip(&images).map(frame).collect(), &request.test);
    let (train, test) = (numbered(train), numbered(test));
    let selections = published::forward_facing(train.len());
    let mut found = Found::new(dir, Format::Llff, train, test, StatedExtent::Depths(range.0, range.1));
    found.warnings.extend(depth_warnings(&rows));
    found.selections = selections;
    found.protocols = vec![("regnerf".into(), (0..found.test.len()).collect())];
    if !found.test.is_empty() {
        let text = "near, far, scale and origin are of all photographs, the test ones included, as in LLFF's loader";
        found.notes.push(text.into());
    }
    Ok(found)
}

/// Warns of near depths below a quarter of the median, and of far depths above ten times the median: the least near depth and
/// the greatest far depth scale the whole scene.
fn depth_warnings(rows: &[PoseRow]) -> Vec<String> {
    let mut warnings = Vec::new();
    for (column, side, extreme) in [(15, "near", "least"), (16, "far", "greatest")] {
        let depths: Vec<f64> = rows.iter().map(|row| if column == 15 { row.near } else { row.far }).collect();
        let mut sorted = depths.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        let is_odd = |depth: f64| if column == 15 { depth < 0.25 * median } else { depth > 10.0 * median };
        for (index, depth) in depths.into_iter().enumerate().filter(|(_, depth)| is_odd(*depth)) {
            let text = format!("{side} is {}, the median of all {}", depth as f32, median as f32);
            warnings.push(format!("{MARKER}: [{index}, {column}]: {text}; the {extreme} one scales the scene"));
        }
    }
    warnings
}

/// A row of the file, with its pose in OpenGL's convention.
pub(crate) struct PoseRow {
    pose: DMat4,
    /// Height, width and focal length in pixels.
    size: [f64; 3],
    near: f64,
    far: f64,
}

pub(crate) fn rows(path: &Path, array: Array) -> Result<Vec<PoseRow>, SceneError> {
    if array.shape.len() != 2 || array.shape.get(1) != Some(&(COLUMNS as u64)) {
        return Err(SceneError::malformed(path, EXPECTED, format!("shape {:?}", array.shape)));
    }
    if array.values.is_empty() {
        return Err(SceneError::malformed(path, EXPECTED, "it has no views"));
    }
    array.values.chunks_exact(COLUMNS).enumerate().map(|(i, row)| read_row(path, i, row)).collect()
}

fn read_row(path: &Path, index: usize, row: &[f64]) -> Result<PoseRow, SceneError> {
    let fault = |columns: &str, expected: &str, found: String| {
        SceneError::field(path, format!("[{index}, {columns}]"), expected, found)
    };
    let column = |c: usize| DVec3::new(row[c], row[5 + c], row[10 + c]);
    let [down, right, back, position] = [0, 1, 2, 3].map(column);
    let pose = DMat4::from_cols(right.extend(0.0), -down.extend(0.0), back.extend(0.0), position.extend(1.0));
    let (size, near, far) = ([row[4], row[9], row[14]], row[15], row[16]);
    if let Some(found) = pose::fault(&pose) {
        return Err(fault("0..15", "a 3×5 matrix with a rigid pose", found));
    }
    if !size.iter().all(|side| PIXELS.contains(side)) {
        return Err(fault("4, 9, 14", "positive height, width and focal length", format!("{size:?}")));
    }
    if !(near.is_finite() && far.is_finite() && 0.0 < near && near < far) {
        return Err(fault("15..17", "depths 0 < near < far", format!("{near} and {far}")));
    }
    Ok(PoseRow { pose, size, near, far })
}

/// Scales and recentres the poses, and returns them with near and far.
pub(crate) fn scaled_and_recentred(path: &Path, rows: &[PoseRow]) -> Result<(Vec<DMat4>, (f32, f32)), SceneError> {
    let nearest = rows.iter().map(|r| r.near).fold(f64::INFINITY, f64::min);
    let farthest = rows.iter().map(|r| r.far).fold(0.0, f64::max);
    let scale = 1.0 / (NEAREST * nearest);
    let scaled = |pose: DMat4| DMat4 { w_axis: (pose.w_axis.truncate() * scale).extend(1.0), ..pose };
    let poses: Vec<DMat4> = recentre(rows.iter().map(|r| scaled(r.pose)).collect());
    let far = farthest * scale;
    if let Some(found) = poses.iter().find_map(pose::fault) {
        return Err(SceneError::malformed(path, EXPECTED, format!("scaled to its nearest depth {nearest:e}, {found}")));
    }
    if far > MAX_COORDINATE {
        return Err(SceneError::malformed(path, EXPECTED, format!("depths from {nearest:e} to {farthest:e}")));
    }
    Ok((poses, (MARGIN * (nearest * scale) as f32, far as f32)))
}

/// Moves the mean pose (mean position, mean backward axis, mean up axis made perpendicular) to the
/// identity. Poses without a mean direction are left as they are.
fn recentre(poses: Vec<DMat4>) -> Vec<DMat4> {
    let n = poses.len().max(1) as f64;
    let sum = |column: usize| poses.iter().map(|p| p.col(column).truncate()).sum::<DVec3>();
    let z = sum(2).normalize_or_zero();
    let x = sum(1).cross(z).normalize_or_zero();
    if x == DVec3::ZERO {
        return poses;
    }
    let mean = DMat4::from_cols(x.extend(0.0), z.cross(x).extend(0.0), z.extend(0.0), (sum(3) / n).extend(1.0));
    let inverse = mean.inverse();
    poses.into_iter().map(|p| inverse * p).collect()
}

/// Lists, by name, the images of the folder with the smallest images whose longest side is at least `size`.
fn find_images(dir: &Path, size: Option<u32>) -> Result<Vec<PathBuf>, SceneError> {
    let mut best: Option<Vec<PathBuf>> = None;
    for folder in FOLDERS.map(|f| dir.join(f)).into_iter().filter(|folder| folder.is_dir()) {
        let images = list_photographs(&folder)?;
        let Some(first) = images.first() else { continue };
        if best.is_some() {
            let (width, height) = stored_dimensions(first)?;
            if size.is_none_or(|size| width.max(height) < size) {
                break;
            }
        }
        best = Some(images);
    }
    let expected = || format!("PNG or JPEG images in one of the folders {}", FOLDERS.join(", "));
    best.ok_or_else(|| SceneError::NotFound { path: dir.into(), expected: expected() })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use glam::{DVec3, Vec3};

    use super::super::testing::*;
    use crate::files::npy;
    use infonerf_scene::{Format, Layout, SceneRequest};

    /// Returns the row of a camera at `x` that looks along −z with y up, for full-size images of 16×16.
    fn row(x: f32) -> [f32; 17] {
        [0.0, 1.0, 0.0, x, 16.0, -1.0, 0.0, 0.0, 0.0, 16.0, 0.0, 0.0, 1.0, 0.0, 20.0, 2.0, 10.0]
    }

    fn write(dir: &Path, rows: &[[f32; 17]]) {
        npy::write(&dir.join("poses_bounds.npy"), &[rows.len() as u64, 17], rows.as_flattened()).unwrap();
    }

    fn folder(rows: &[[f32; 17]]) -> tempfile::TempDir {
        let guard = tempfile::tempdir().unwrap();
        write(guard.path(), rows);
        for (name, size) in [("images", 16), ("images_2", 8)] {
            fs::create_dir(guard.path().join(name)).unwrap();
            for i in 0..rows.len() {
                image(size, i as u8).write_png(&guard.path().join(format!("{name}/image{i:03}.png"))).unwrap();
            }
        }
        guard
    }

    fn rows() -> [[f32; 17]; 9] {
        std::array::from_fn(|i| row(i as f32))
    }

    #[test]
    fn converts_scales_and_recentres() {
        let guard = folder(&rows());
        let scene = load(guard.path(), &request()).unwrap();
        assert_eq!((scene.train.len(), scene.test.len()), (7, 2));
        // Depth 2 becomes 4/3; the mean position, x = 4, becomes the origin.
        let scale = 1.0 / 1.5;
        let camera = &scene.train[0].camera;
        assert!((camera.position() - Vec3::X * (1.0 - 4.0) * scale).length() < 1e-6);
        assert!((camera.forward() - Vec3::NEG_Z).length() < 1e-6);
        assert!((camera.to_world.y_axis.truncate() - DVec3::Y).length() < 1e-9);
        assert!((scene.space.near - 0.9 * 2.0 * scale).abs() < 1e-6);
        let mut rows = rows();
        assert!(scene.warnings.is_empty() && scene.notes[0].starts_with("near, far, scale"), "{:?}", scene.warnings);
        (rows[5][15], rows[6][16]) = (0.2, 120.0);
        let warnings = load(folder(&rows).path(), &request()).unwrap().warnings.join("\n");
        assert!(
            warnings.contains(
                "poses_bounds.npy: [5, 15]: near is 0.2, the median of all 2; the least one scales the scene"
            )
        );
        assert!(warnings.contains("[6, 16]: far is 120, the median of all 10; the greatest one scales the scene"));
        // Far is a depth: along the ray through a corner it is farther away.
        let corner = camera.ray(0.0, 0.0);
        let (near, far) = scene.interval(&corner).unwrap();
        let slant = (1.0 + 2.0 * 0.4f32 * 0.4).sqrt();
        assert!((near - scene.space.near * slant).abs() < 1e-5 && (far - 10.0 * scale * slant).abs() < 1e-4);
        assert!((scene.interval(&camera.ray(8.0, 8.0)).unwrap().1 - 10.0 * scale).abs() < 1e-4);
        assert!((scene.space.far - far).abs() < 1e-4, "no ray goes farther");
        assert!((scene.space.bounds.min.z + 10.0 * scale).abs() < 1e-4, "bounds reach the farthest depth");
        assert!(scene.space.bounds.contains(corner.at(0.999 * far)));
        assert_eq!((scene.format, scene.space.layout, scene.space.bounded), (Format::Llff, Layout::Forward, false));
        assert_eq!(scene.space.up, Vec3::Y);
        assert_eq!((camera.width, camera.fx), (16, 20.0));
        let many = SceneRequest { train: "regnerf-9".parse().unwrap(), ..request() };
        assert!(message(guard.path(), &many).contains("one of regnerf-2, regnerf-3, regnerf-6"));
        // The folder that suits the size is taken.
        let sized = |size: u32| SceneRequest { image_size: Some(size), ..request() };
        let scene = load(guard.path(), &sized(8)).unwrap();
        assert_eq!(scene.train[0].name, "images_2/image001");
        assert_eq!((scene.train[0].camera.width, scene.train[0].camera.fx), (8, 10.0));
        assert_eq!(load(guard.path(), &sized(9)).unwrap().train[0].name, "images/image001");
    }

    #[test]
    fn faults() {
        let guard = folder(&rows());
        fs::remove_file(guard.path().join("images/image003.png")).unwrap();
        assert!(message(guard.path(), &request()).contains("expected 9 images, one for each pose"));

        let guard = tempfile::tempdir().unwrap();
        write(guard.path(), &rows());
        assert!(message(guard.path(), &request()).contains("images, images_2"));

        let bad = |column: usize, value: f32| {
            let mut rows = rows();
            rows[5][column] = value;
            message(folder(&rows).path(), &request())
        };
        assert!(bad(1, 0.0).contains("field `[5, 0..15]`: expected a 3×5 matrix"));
        assert!(bad(3, f32::NAN).contains("not finite"));
        let text = bad(4, 12.0);
        assert!(text.contains("field `[5, 4, 9]`: expected a height and width in the proportions of the images"));
        assert!(bad(14, 0.0).contains("field `[5, 4, 9, 14]`"));
        assert!(bad(15, 20.0).contains("expected depths 0 < near < far, found 20 and 10"));

        let guard = folder(&rows());
        npy::write(&guard.path().join("poses_bounds.npy"), &[9, 15], &[0.0; 135]).unwrap();
        assert!(message(guard.path(), &request()).contains("[N, 17] of poses and depth bounds: shape [9, 15]"));
        npy::write::<f64>(&guard.path().join("poses_bounds.npy"), &[0, 17], &[]).unwrap();
        assert!(message(guard.path(), &request()).contains("no views"));
    }
}
