//! Scans of DTU as IDR, NeuS and pixelNeRF keep them: `image`, `mask` and projection matrices.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3, Vec3};
use infonerf_scene::image::{list_images, stored_dimensions};
use infonerf_scene::{Aabb, Camera, Format, Layout, Range, SceneError, SceneRequest, Space};

use super::pose;
use crate::capture::{Found, StatedExtent, capture_space};
use crate::colmap::opengl;
use crate::files::npy::{self, Arrays};
use crate::files::{PIXELS, read_file};
use crate::frame::{Frame, MaskRole};

pub(crate) const MARKER: &str = "cameras_sphere.npz, cameras.npz";
const FILES: [&str; 2] = ["cameras_sphere.npz", "cameras.npz"];
/// Lists next to the scans by which pixelNeRF's copy is recognized.
const LISTS: [&str; 2] = ["new_train.lst", "new_val.lst"];
pub(crate) const EXPECTED: &str = "4×4 matrices world_mat_0, scale_mat_0 and so on";

const VIEWS: usize = 49;
/// RegNeRF's training views, in the order in which they are taken.
const REGNERF: [usize; 9] = [25, 22, 28, 40, 44, 48, 0, 8, 13];
/// The training views of pixelNeRF, and of the paper.
const PIXELNERF: [usize; 3] = [22, 25, 28];
/// Views that no protocol tests: the exposure is wrong.
const LEFT_OUT: [usize; 15] = [3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 36, 37, 38, 39];
/// Near and far between which pixelNeRF samples its copy.
const PIXELNERF_RANGE: (f32, f32) = (0.1, 5.0);
/// Max skew, divided by the focal length, that counts as rounding.
const SKEW: f64 = 1e-3;

pub(crate) fn cameras_file(dir: &Path) -> Option<PathBuf> {
    FILES.iter().map(|file| dir.join(file)).find(|file| file.is_file())
}

/// Reads the folder of a scan.
///
/// The id of a view is the place of its image in the order of names. Image `i` has the projection `world_mat_i`; in a scan with
/// fewer images than projections, `i` is the number that ends the image's name. `scale_mat_i` maps the unit sphere, which
/// contains the object, to the world. In a whole scan the test split is RegNeRF's 25 test views, and the training pool all
/// others; in other scans every 8th view is held out.
///
/// pixelNeRF's copy (`new_train.lst` next to the scans) has no sphere: near and far are 0.1 and 5.
pub(super) fn read<'a>(dir: &'a Path, _: &SceneRequest) -> Result<Found<'a>, SceneError> {
    let path = cameras_file(dir).unwrap_or_else(|| dir.join(FILES[0]));
    let wanted = |name: &str| name.starts_with("world_mat_") || name.starts_with("scale_mat_");
    let bytes = read_file(&path, EXPECTED, npy::MAX_ARCHIVE)?;
    let matrices = npy::decode_archive(&path, &bytes, EXPECTED, |name| wanted(name) && !name.contains("inv"))?;
    let folder = dir.join("image");
    let images = if folder.is_dir() { list_images(&folder)? } else { Vec::new() };
    let masks = if dir.join("mask").is_dir() { list_images(&dir.join("mask"))? } else { Vec::new() };
    let Some(first) = images.first() else {
        return Err(SceneError::NotFound { path: folder, expected: "the images of the scan".into() });
    };
    if !masks.is_empty() && masks.len() != images.len() {
        let expected = format!("{} masks, one for each image", images.len());
        return Err(SceneError::malformed(&dir.join("mask"), expected, format!("it has {}", masks.len())));
    }
    let size = stored_dimensions(first)?;
    let projections = matrices.keys().filter(|name| name.starts_with("world_mat_")).count();
    let mut frames = Vec::new();
    for (id, image) in images.iter().enumerate() {
        let index = if images.len() < projections { number_of(image, projections)? } else { id };
        let camera = camera(&path, &matrices, index, size)?;
        let name = image.strip_prefix(dir).unwrap_or(image).to_string_lossy().into_owned();
        let mask = masks.get(id).map(|mask| (mask.clone(), MaskRole::Counts));
        frames.push(Frame { id, mask, ..Frame::new(&name, image.clone(), &camera) });
    }
    let pixelnerf = dir.parent().is_some_and(|root| LISTS.iter().any(|list| root.join(list).is_file()));
    let whole = frames.len() >= VIEWS;
    let tested = |i: &usize| {
        if whole { *i < VIEWS && !LEFT_OUT.contains(i) && !REGNERF.contains(i) } else { i.is_multiple_of(8) }
    };
    let split: Vec<usize> = (0..frames.len()).filter(|i| tested(i) && frames.len() > 1).collect();
    let train: Vec<Frame> = frames.iter().filter(|f| !split.contains(&f.id)).cloned().collect();
    let cameras: Vec<Camera> = train.iter().map(Frame::nominal_camera).collect();
    let space = if pixelnerf {
        capture_space(&cameras, Vec::new(), Vec::new()).with(Some(PIXELNERF_RANGE), None)
    } else {
        sphere(&cameras)
    };
    let mut found = Found::new(dir, Format::Dtu, train, frames, StatedExtent::Known(Box::new(space)));
    if whole {
        found.selections = [1, 3, 6, 9].map(|n| (format!("regnerf-{n}"), REGNERF[..n].to_vec())).to_vec();
        found.selections.extend(["pixelnerf-3", "infonerf-3"].map(|name| (name.into(), PIXELNERF.to_vec())));
        let others: Vec<usize> = (0..VIEWS).filter(|i| !LEFT_OUT.contains(i) && !PIXELNERF.contains(i)).collect();
        found.protocols = vec![("regnerf".into(), split.clone())];
        found.protocols.extend(["pixelnerf", "infonerf"].map(|name| (name.into(), others.clone())));
    } else {
        found.warnings.push(format!("{} views instead of DTU's {VIEWS}: every 8th is held out", found.test.len()));
    }
    found.split = Some(split);
    Ok(found)
}

/// Returns the number that ends the name of an image of a scan from which others were removed.
fn number_of(image: &Path, projections: usize) -> Result<usize, SceneError> {
    let stem = image.file_stem().unwrap_or_default().to_string_lossy();
    let digits = stem.rsplit(|c: char| !c.is_ascii_digit()).next().unwrap_or_default();
    digits.parse().map_err(|_| {
        let expected =
            format!("one image for each of the {projections} projections, or names that end in their numbers");
        SceneError::malformed(image, expected, "it has another name")
    })
}

/// Returns the space of the unit sphere at the origin, seen by `cameras`.
fn sphere(cameras: &[Camera]) -> Space {
    let distances = cameras.iter().map(|c| c.position().length());
    let (nearest, farthest) = distances.fold((f32::INFINITY, 0f32), |(a, b), d| (a.min(d), b.max(d)));
    let ends = ((nearest - 1.0).max(0.0), farthest + 1.0);
    let range = Range::Sphere { centre: Vec3::ZERO, radius: 1.0 };
    // The table and what is behind it lie outside.
    let bounded = false;
    Space { range, bounded, layout: Layout::Object, ..Space::known(cameras, ends, Aabb::cube(Vec3::ZERO, 1.0)) }
}

/// Makes camera `index` from `world_mat` = `K [R | t]`, and applies the inverse of `scale_mat` to its position.
pub(crate) fn camera(path: &Path, matrices: &Arrays, index: usize, size: (u32, u32)) -> Result<Camera, SceneError> {
    let world = matrix(path, matrices, &format!("world_mat_{index}"))?;
    let scale = matrix(path, matrices, &format!("scale_mat_{index}"))?;
    let fault =
        |name: &str, expected: &str, found: String| SceneError::field(path, format!("{name}_{index}"), expected, found);
    let camera = decompose(&world, size).map_err(|found| fault("world_mat", "a projection K [R | t]", found))?;
    let factor = scale.x_axis.x;
    let rest = DMat3::from_mat4(scale) - DMat3::from_diagonal(DVec3::splat(factor));
    if !(factor > 1e-9 && rest.abs_diff_eq(DMat3::ZERO, 1e-4 * factor)) {
        let found = format!("{:?}", scale.transpose().to_cols_array_2d());
        return Err(fault("scale_mat", "one positive scale, three times on the diagonal, and a translation", found));
    }
    let place = (camera.position_f64() - scale.w_axis.truncate()) / factor;
    let pose = DMat4 { w_axis: place.extend(1.0), ..camera.to_world };
    match pose::fault(&pose) {
        Some(found) => Err(fault("world_mat", "a projection K [R | t]", found)),
        None => Ok(camera.with_pose(pose)),
    }
}

fn matrix(path: &Path, matrices: &Arrays, name: &str) -> Result<DMat4, SceneError> {
    let fault = |found: &str| SceneError::field(path, name, "a finite 4×4 matrix", found);
    let array = matrices.get(name).ok_or_else(|| fault("nothing"))?;
    match <[f64; 16]>::try_from(array.values.as_slice()) {
        Ok(values) if array.shape == [4, 4] => {
            let matrix = DMat4::from_cols_array(&values).transpose();
            if matrix.is_finite() { Ok(matrix) } else { Err(fault("a value that is not finite")) }
        }
        _ => Err(fault(&format!("shape {:?}", array.shape))),
    }
}

/// Decomposes `K [R | t]`, given up to scale, into a camera. R has the rows of `K R`, orthogonalized from last to first.
fn decompose(matrix: &DMat4, size: (u32, u32)) -> Result<Camera, String> {
    let rows = DMat3::from_mat4(*matrix).transpose();
    let sign = if rows.determinant() < 0.0 { -1.0 } else { 1.0 };
    let (m1, m2, m3) = (sign * rows.x_axis, sign * rows.y_axis, sign * rows.z_axis);
    let scale = m3.length();
    let r3 = m3.try_normalize().ok_or("a last row of zeros")?;
    let across = m2 - m2.dot(r3) * r3;
    let r2 = across.try_normalize().ok_or("rows that are multiples of each other")?;
    let along = m1 - m1.dot(r3) * r3;
    let skew = along.dot(r2) / scale;
    let r1 = (along - along.dot(r2) * r2).try_normalize().ok_or("rows that are multiples of each other")?;
    let focal = [(along - along.dot(r2) * r2).length() / scale, across.length() / scale];
    if !focal.iter().all(|f| PIXELS.contains(f)) {
        return Err(format!("focal lengths {focal:?}"));
    }
    if skew.abs() > SKEW * focal[0] {
        return Err(format!("a skew of {skew} pixels"));
    }
    let centre = -(DMat3::from_mat4(*matrix).inverse() * matrix.w_axis.truncate());
    if !centre.is_finite() {
        return Err("a singular matrix".into());
    }
    // In the matrix's coordinates pixel centres are whole numbers.
    let centre_pixel = [m1, m2].map(|row| row.dot(r3) / scale + 0.5);
    Ok(Camera::pinhole(size, focal, centre_pixel, opengl(DMat3::from_cols(r1, r2, r3), centre)))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use glam::{DMat4, DVec3, Vec3};

    use super::super::testing::*;
    use crate::export::matrices;
    use crate::files::npy::{self, NamedArray};
    use infonerf_scene::{Backdrop, Camera, Format, Layout, SceneRequest, TestProtocol, ViewSelection};

    /// Scale and translation of the unit sphere in the toy's world.
    const SCALE: f64 = 250.0;
    const SHIFT: DVec3 = DVec3::new(10.0, -20.0, 600.0);

    /// Returns the matrices of cameras in a world scaled by [`SCALE`] and moved by [`SHIFT`].
    fn arrays(cameras: &[Camera]) -> Vec<NamedArray> {
        let scale = DMat4::from_translation(SHIFT) * DMat4::from_scale(DVec3::splat(SCALE));
        let moved = |camera: &Camera| moved(camera, |p| p * SCALE + SHIFT);
        let moved: Vec<Camera> = cameras.iter().map(moved).collect();
        let mut arrays = matrices(moved.iter(), scale);
        arrays.push(("world_mat_inv_0".into(), vec![1], vec![0.0]));
        arrays
    }

    fn folder(dir: &Path, n: usize, masks: bool) -> Vec<Camera> {
        let camera = |c: &Camera| Camera::pinhole((16, 12), [22.0, 21.0], [8.25, 5.75], c.to_world);
        let cameras: Vec<Camera> = infonerf_procedural::train_cameras(8)[..n].iter().map(camera).collect();
        fs::create_dir_all(dir.join("image")).unwrap();
        npy::write_archive(&dir.join("cameras_sphere.npz"), &arrays(&cameras)).unwrap();
        for (i, camera) in cameras.iter().enumerate() {
            write_view(&dir.join(format!("image/{i:06}.png")), camera);
            if masks {
                fs::create_dir_all(dir.join("mask")).unwrap();
                write_mask(&dir.join(format!("mask/{i:03}.png")), (16, 12), |pixel| pixel >= 96);
            }
        }
        cameras
    }

    #[test]
    fn a_procedural_scene_round_trips() {
        let guard = tempfile::tempdir().unwrap();
        let cameras = folder(guard.path(), 9, true);
        let scene = load(guard.path(), &SceneRequest { test: TestProtocol::Split, ..request() }).unwrap();
        assert_eq!(scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(scene.test.iter().map(|v| v.id).collect::<Vec<_>>(), [0, 8]);
        for view in scene.train.iter().chain(&scene.test) {
            assert_same_view(view, &cameras[view.id]);
            let mask = view.mask.as_deref().unwrap();
            assert!(!mask[95] && mask[96]);
        }
        assert_eq!((scene.format, scene.space.layout, scene.space.bounded), (Format::Dtu, Layout::Object, true));
        let ray = scene.train[0].camera.ray(8.25, 5.75);
        let (near, far) = scene.interval(&ray).unwrap();
        assert!((near - 3.0311).abs() < 1e-3 && (far - 5.0311).abs() < 1e-3);
        assert_eq!(scene.space.bounds.max, Vec3::ONE);
        assert!(scene.warnings[0].contains("9 views instead of DTU's 49"));
        // Training views are not tested.
        let all = load(guard.path(), &SceneRequest { train: "4,2".parse().unwrap(), ..request() }).unwrap();
        assert_eq!(all.train.iter().map(|v| v.id).collect::<Vec<_>>(), [4, 2]);
        assert_eq!(all.test.iter().map(|v| v.id).collect::<Vec<_>>(), [0, 1, 3, 5, 6, 7, 8]);
    }

    #[test]
    fn images_left_of_a_scan_keep_their_cameras() {
        let guard = tempfile::tempdir().unwrap();
        let cameras = folder(guard.path(), 5, false);
        let remove = |i: usize| fs::remove_file(guard.path().join(format!("image/{i:06}.png"))).unwrap();
        [0, 2, 3].into_iter().for_each(remove);
        fs::rename(guard.path().join("image/000004.png"), guard.path().join("image/scan8_000004.png")).unwrap();
        let scene = load(guard.path(), &SceneRequest { test: TestProtocol::Split, ..request() }).unwrap();
        assert_same_view(&scene.test[0], &cameras[1]);
        assert_same_view(&scene.train[0], &cameras[4]);
        fs::rename(guard.path().join("image/000001.png"), guard.path().join("image/left.png")).unwrap();
        let text = message(guard.path(), &request());
        assert!(text.contains("left.png: expected one image for each of the 5 projections"), "{text}");
    }

    #[test]
    fn published_views_of_a_whole_scan() {
        let guard = tempfile::tempdir().unwrap();
        folder(guard.path(), 49, false);
        let ask = |train: &str, test: &str| {
            let chosen = SceneRequest { train: train.parse().unwrap(), test: test.parse().unwrap(), ..request() };
            let scene = load(guard.path(), &chosen).unwrap();
            (scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), scene.test.iter().map(|v| v.id).collect::<Vec<_>>())
        };
        let (train, test) = ask("regnerf-3", "split");
        assert_eq!((train, test.len()), (vec![25, 22, 28], 25));
        assert_eq!(test[..5], [1, 2, 9, 10, 11]);
        assert_eq!(ask("regnerf-9", "regnerf").1, test);
        let (train, others) = ask("infonerf-3", "pixelnerf");
        assert_eq!((train, others.len()), (vec![22, 25, 28], 31));
        let leak = SceneRequest { train: ViewSelection::Ids { ids: vec![1] }, ..request() };
        assert!(message(guard.path(), &leak).contains("found 1"), "a test view is not trained on");
    }

    #[test]
    fn pixelnerfs_copy_has_its_own_range() {
        let guard = tempfile::tempdir().unwrap();
        fs::write(guard.path().join("new_val.lst"), "scan8\n").unwrap();
        let dir = guard.path().join("scan8");
        let cameras = folder(&dir, 3, false);
        fs::rename(dir.join("cameras_sphere.npz"), dir.join("cameras.npz")).unwrap();
        let scene = load(&dir, &request()).unwrap();
        assert_same_view(&scene.train[0], &cameras[1]);
        assert_eq!((scene.space.near, scene.space.far), (0.1, 5.0));
        assert_eq!(scene.backdrop, Backdrop::Colour, "knot has an alpha channel");
    }

    #[test]
    fn faults() {
        let bad = |change: &dyn Fn(&mut Vec<NamedArray>)| {
            let guard = tempfile::tempdir().unwrap();
            let cameras = folder(guard.path(), 3, false);
            let mut arrays = arrays(&cameras);
            change(&mut arrays);
            npy::write_archive(&guard.path().join("cameras_sphere.npz"), &arrays).unwrap();
            message(guard.path(), &request())
        };
        assert!(bad(&|a| drop(a.remove(2))).contains("`world_mat_1`: expected a finite 4×4 matrix, found nothing"));
        assert!(bad(&|a| a[2].2[5] = f64::NAN).contains("not finite"));
        assert!(bad(&|a| a[2].2[..12].fill(0.0)).contains("a last row of zeros"));
        assert!(bad(&|a| a[2].1 = vec![16]).contains("shape [16]"));
        for scales in [[0.0; 3], [SCALE, SCALE, 1.01 * SCALE]] {
            let text = bad(&|a| (0..3).for_each(|axis| a[3].2[5 * axis] = scales[axis]));
            assert!(text.contains("cameras_sphere.npz: field `scale_mat_1`: expected one positive scale"), "{text}");
        }
        let guard = tempfile::tempdir().unwrap();
        folder(guard.path(), 3, true);
        fs::remove_file(guard.path().join("mask/001.png")).unwrap();
        assert!(message(guard.path(), &request()).contains("expected 3 masks, one for each image: it has 2"));
        fs::remove_dir_all(guard.path().join("image")).unwrap();
        assert!(message(guard.path(), &request()).ends_with("image: not found; expected the images of the scan"));
        let archive = guard.path().join("cameras_sphere.npz");
        let whole = fs::read(&archive).unwrap();
        for keep in [0, 2, 30, whole.len() / 2] {
            fs::write(&archive, &whole[..keep]).unwrap();
            assert!(message(guard.path(), &request()).contains("cameras_sphere.npz: expected 4×4 matrices"));
        }
    }
}
