//! Captures that COLMAP has reconstructed: `sparse/0` next to a folder of images.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use infonerf_scene::image::stored_dimensions;
use infonerf_scene::{Format, SceneError, SceneRequest};

use super::llff::FOLDERS;
use crate::capture::{Estimate, Found, IMAGE_FOLDERS, list_photographs, same_proportions, some_of};
use crate::colmap::{Reconstruction, models, path_of};
use crate::files::file_name;
use crate::frame::{Frame, Listed, find_by_end, keep_apart};
use crate::photographs::{OWN_POSES, changed_photographs};

/// Name of this format's file in messages.
pub(super) const MARKER: &str = "sparse/0/cameras.bin (or .txt)";

/// Reads a folder with a COLMAP reconstruction.
///
/// Images come from the smallest of `images`, `images_2`, `images_4`, `images_8` that is at least as large as the
/// request (without one: `images`), next to the reconstruction or in `dir`; or from another of [`IMAGE_FOLDERS`]. Frames
/// without an image are left out with a warning. Every 8th by name, starting with the first, is held out for test. The
/// points that training photographs see give bounds, near and far; without observations all do, with a warning.
pub(super) fn read<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Found<'a>, SceneError> {
    let models = models(dir);
    let place = models.first().map_or(dir, |(place, _)| place);
    let read = Reconstruction::read_at(place)?;
    let names: Vec<String> = read.images.iter().map(|image| image.name.replace('\\', "/")).collect();
    let roots = roots(dir, place);
    let mut listed = Listed::new();
    let folder = image_folder(&roots, &names, request.image_size, &mut listed)?;
    let reduced = !IMAGE_FOLDERS.contains(&&*file_name(&folder)) && folder != dir;
    let index: BTreeMap<u64, usize> = read.points.keys().zip(0..).map(|(&id, index)| (id, index)).collect();
    let (mut frames, mut stated) = (Vec::new(), Vec::new());
    for (image, name) in read.images.iter().zip(&names) {
        let Some(mut camera) = read.camera(image) else { continue };
        stated.push(folder.join(name));
        let (path, name) = find_by_end(&folder, name, &mut listed).unwrap_or_else(|| (folder.join(name), name));
        if reduced && path.is_file() {
            let (width, height) = stored_dimensions(&path)?;
            // An image of other proportions, which was turned or cropped, is refused by its name.
            if same_proportions((camera.width, camera.height), (width, height)) {
                camera = camera.resized(width, height);
            }
        }
        let points = image.observations.iter().filter_map(|(_, id)| index.get(id).copied()).collect();
        frames.push(Frame { points, ..Frame::new(name, path, &camera) });
    }
    let alike = keep_apart(&folder, &mut frames, &stated);
    // Poses of the same photographs would leave out the same ones again.
    let is_final = !place.starts_with(dir.join("sparse")) || changed_photographs(dir)? == Some(Vec::new());
    let remedy = if is_final { "" } else { "; remove the scene's folder `sparse` to find the poses again" };
    let lost = without_pose(&folder, &frames).map(|lost| lost + remedy);
    let points: Vec<DVec3> = read.points.values().copied().collect();
    let behind = points_behind(&points, &frames).map(|counts| {
        let file = path_of(place, "points3D");
        let doubt = "are the poses beside it world to camera, with y down and z forward?";
        let file = file.strip_prefix(dir).unwrap_or(&file).display();
        format!("{counts} of {file} lie behind the cameras that see them: {doubt}")
    });
    let estimate = Estimate { points, ..Estimate::default() };
    let mut found = Found::captured(dir, Format::Colmap, frames, &request.test, estimate);
    found.fits_shown = place.join(OWN_POSES).is_file();
    found.warnings.extend(lost.into_iter().chain(alike).chain(behind));
    if let [(place, count), (_, next), ..] = &models[..] {
        let (name, all) = (place.strip_prefix(dir).unwrap_or(place).display(), models.len());
        let others = format!("of {all} reconstructions {name} is read, with {count} images; the next has {next}");
        found.warnings.push(others);
    }
    Ok(found)
}

/// Returns the folders that may hold the folder of images: those above the reconstruction up to `dir`, the nearest first.
fn roots(dir: &Path, place: &Path) -> Vec<PathBuf> {
    let above = place.ancestors().skip(usize::from(place != dir));
    above.take_while(|folder| folder.starts_with(dir)).map(Path::to_owned).collect()
}

/// Counts the points that lie behind every camera that sees them, or behind all cameras if no frame says what it sees, as
/// `N of M points`; `None` if these are not most points.
fn points_behind(points: &[DVec3], frames: &[Frame]) -> Option<String> {
    let all: Vec<usize> = (0..points.len()).collect();
    let is_unknown = frames.iter().all(|frame| frame.points.is_empty());
    let mut is_in_front = vec![None; points.len()];
    for frame in frames {
        let (position, backward) = (frame.pose.w_axis.truncate(), frame.pose.z_axis.truncate());
        for &point in if is_unknown { &all } else { &frame.points } {
            *is_in_front[point].get_or_insert(false) |= (points[point] - position).dot(backward) < 0.0;
        }
    }
    let seen: Vec<bool> = is_in_front.into_iter().flatten().collect();
    let behind = seen.iter().filter(|is_in_front| !**is_in_front).count();
    (2 * behind > seen.len()).then(|| format!("{behind} of {} points", seen.len()))
}

/// Returns a warning that names the photographs in `folder` without a pose.
fn without_pose(folder: &Path, frames: &[Frame]) -> Option<String> {
    let known: HashSet<&Path> = frames.iter().map(|frame| frame.image.as_path()).collect();
    let all = list_photographs(folder).ok()?;
    let lost = all.iter().filter(|path| !known.contains(path.as_path())).map(|path| file_name(path));
    some_of(&lost.collect::<Vec<_>>(), all.len(), "photographs without a pose")
}

/// Returns the folder of the smallest images whose longest side is at least `size`, among those with all images of the whole
/// ones; or a folder of reduced images if there are no others.
fn image_folder(
    roots: &[PathBuf],
    names: &[String],
    size: Option<u32>,
    listed: &mut Listed,
) -> Result<PathBuf, SceneError> {
    let mut images =
        |folder: &Path| Vec::from_iter(names.iter().filter_map(|name| Some(find_by_end(folder, name, listed)?.0)));
    let whole = roots.iter().flat_map(|root| IMAGE_FOLDERS.map(|name| root.join(name)));
    let reduced = roots.iter().flat_map(|root| FOLDERS.map(|name| root.join(name)));
    let found = whole.chain(reduced).chain(roots.iter().cloned()).find(|folder| !images(folder).is_empty());
    let mut best = found.unwrap_or_else(|| roots[roots.len() - 1].join(FOLDERS[0]));
    let (Some(size), Some(root)) = (size, best.parent()) else { return Ok(best) };
    if best.file_name().is_none_or(|name| name != FOLDERS[0]) && best.is_dir() {
        return Ok(best);
    }
    let all = images(&best).len();
    for folder in FOLDERS.map(|f| root.join(f)) {
        let found = images(&folder);
        let Some(first) = found.first().filter(|_| found.len() >= all) else { continue };
        let (width, height) = stored_dimensions(first)?;
        if width.max(height) >= size {
            best = folder;
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use glam::{DMat4, DVec2, DVec3};
    use tempfile::TempDir;

    use super::super::testing::*;
    use crate::colmap::testing::{reconstruction, write_binary, write_text};
    use crate::colmap::{ColmapCamera, Reconstruction};
    use infonerf_procedural::train_cameras;
    use infonerf_scene::{Backdrop, Camera, Format, Layout, SceneRequest};

    /// Returns a ball's points and nine views of `knot` through the lens of a FULL_OPENCV camera, without the file of image 8.
    fn folder(write: fn(&Path, &Reconstruction)) -> (TempDir, Vec<Camera>) {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        let lens = [24.0, 25.0, 10.5, 8.0, 0.1, 0.02, 1e-3, -1e-3, 0.01, 0.05, 0.02, 0.0];
        let camera = ColmapCamera::new(dir, "camera", 6, (20, 16), lens.to_vec()).unwrap();
        let cameras: Vec<Camera> = train_cameras(8)[..9].iter().map(|from| camera.at(from.to_world)).collect();
        let point = |i: u64| DVec3::new((i as f64).sin(), (i as f64 * 1.7).sin(), (i as f64 * 0.6).cos());
        let mut all = reconstruction(camera, &cameras, |i| format!("v/{i}.png"));
        all.points = (0..200).map(|i| (i, point(i))).collect();
        all.images.iter_mut().for_each(|image| image.observations = (0..200).map(|p| (DVec2::ZERO, p)).collect());
        write(&dir.join("sparse/0"), &all);
        fs::create_dir_all(dir.join("images/v")).unwrap();
        for (i, camera) in cameras[..8].iter().enumerate() {
            write_view(&dir.join(format!("images/v/{i}.png")), camera);
        }
        (guard, cameras)
    }

    #[test]
    fn a_procedural_scene_round_trips() {
        for write in [write_binary, write_text] {
            let (guard, cameras) = folder(write);
            let scene = load(guard.path(), &request()).unwrap();
            assert_eq!((scene.train.len(), scene.test.len(), scene.format), (7, 1, Format::Colmap));
            assert_eq!(scene.train[0].name, "v/1");
            for (view, camera) in scene.train.iter().zip(&cameras[1..]) {
                assert_same_view(view, camera);
            }
            assert_eq!(scene.warnings.len(), 1);
            assert_warns(&scene, 0, "1 of 9 frames without an image, such as ");
            assert_eq!((scene.space.layout, scene.backdrop), (Layout::Object, Backdrop::Colour));
            assert_eq!(scene.space.points.len(), 200);
            assert!((2.0..3.1).contains(&scene.space.near) && (4.9..6.5).contains(&scene.space.far), "{scene:?}");
            assert!((scene.space.bounds.max.x - 1.2).abs() < 0.05);
        }
    }

    /// Checks that neither cameras of test photographs nor points that only these see change the space.
    #[test]
    fn test_photographs_do_not_shape_the_space() {
        let (guard, _) = folder(write_binary);
        let place = guard.path().join("sparse/0");
        let mut all = Reconstruction::read(guard.path()).unwrap();
        write_binary(&place, &all);
        let before = load(guard.path(), &request()).unwrap();
        all.images[0].pose.w_axis.x += 10.0;
        for i in 0..100 {
            all.points.insert(1000 + i, DVec3::new(30.0, i as f64, 0.0));
            all.images[0].observations.push((DVec2::ZERO, 1000 + i));
        }
        write_binary(&place, &all);
        let after = load(guard.path(), &request()).unwrap();
        assert!(after.test != before.test && infonerf_scene::Scene { test: before.test.clone(), ..after } == before);
        // Without observations all points count.
        all.images.iter_mut().for_each(|image| image.observations.clear());
        write_binary(&place, &all);
        let unseen = load(guard.path(), &request()).unwrap();
        assert!(unseen.space.points.len() == 300 && unseen.warnings[1].contains("does not say who sees a point"));
    }

    #[test]
    fn smaller_images_take_their_cameras_with_them() {
        let (guard, cameras) = folder(write_binary);
        fs::create_dir_all(guard.path().join("images_2/v")).unwrap();
        for (i, camera) in cameras[..8].iter().enumerate() {
            write_view(&guard.path().join(format!("images_2/v/{i}.png")), &camera.resized(10, 8));
        }
        let scene = load(guard.path(), &SceneRequest { image_size: Some(10), ..request() }).unwrap();
        assert_same_view(&scene.train[0], &cameras[1].resized(10, 8));
        assert!(!scene.train[0].camera.lens.is_perspective());
        // The reduced images alone, and then without one of them.
        fs::rename(guard.path().join("images"), guard.path().join("moved")).unwrap();
        assert_same_view(&load(guard.path(), &request()).unwrap().train[0], &cameras[1].resized(10, 8));
        fs::rename(guard.path().join("moved"), guard.path().join("images")).unwrap();
        // A reduced image that was cropped.
        let third = guard.path().join("images_2/v/3.png");
        write_view(&third, &cameras[3].resized(8, 8));
        let text = message(guard.path(), &SceneRequest { image_size: Some(8), ..request() });
        assert!(text.contains("3.png: expected an image of 20×16 pixels"), "{text}");
        fs::remove_file(third).unwrap();
        let whole = load(guard.path(), &SceneRequest { image_size: Some(10), ..request() }).unwrap();
        assert_eq!(whole.train.len(), scene.train.len());
    }

    /// Covers images in `input`, `frames` and `rgb`, paths from the project's folder or another computer, and other extensions.
    #[test]
    fn images_are_found_wherever_they_are() {
        for (disk, named) in [
            ("images/v", "/home/me/scan/images/v/0.png"),
            ("rgb/v", "images\\v\\0.JPG"),
            ("input/v", "v/0.png"),
            ("frames/v", "v/0.png"),
            ("images/V", "v/0.png"),
        ] {
            let (guard, _) = folder(write_text);
            let mut all = Reconstruction::read(guard.path()).unwrap();
            all.images.iter_mut().enumerate().for_each(|(i, image)| image.name = named.replace('0', &i.to_string()));
            write_text(&guard.path().join("sparse/0"), &all);
            fs::rename(guard.path().join("images"), guard.path().join("moved")).unwrap();
            fs::create_dir_all(guard.path().join(disk).parent().unwrap()).unwrap();
            fs::rename(guard.path().join("moved/v"), guard.path().join(disk)).unwrap();
            let scene = load(guard.path(), &request()).unwrap();
            assert_eq!((scene.train.len(), scene.train[0].name.as_str()), (7, "v/1"), "{named}");
        }
    }

    #[test]
    fn photographs_without_a_pose_are_counted_and_faults_named() {
        let (guard, cameras) = folder(write_binary);
        fs::write(guard.path().join("images/lost.png"), []).unwrap();
        let warnings = super::read(guard.path(), &request()).unwrap().warnings;
        assert!(warnings[1].contains("1 of 1 photographs without a pose: lost.png; remove"), "{warnings:?}");
        let mut all = Reconstruction::read(guard.path()).unwrap();
        all.images.iter_mut().for_each(|image| image.pose *= DMat4::from_rotation_y(std::f64::consts::PI));
        write_binary(&guard.path().join("sparse/0"), &all);
        let warnings = super::read(guard.path(), &request()).unwrap().warnings;
        let behind = "200 of 200 points of sparse/0/points3D.bin lie behind the cameras that see them: are the poses";
        assert!(warnings.len() == 3 && warnings[2].starts_with(behind), "{warnings:?}");
        write_view(&guard.path().join("images/v/3.png"), &cameras[3].resized(10, 16));
        assert!(message(guard.path(), &request()).contains("3.png: expected an image of 20×16 pixels"));
        fs::remove_dir_all(guard.path().join("images")).unwrap();
        assert!(message(guard.path(), &request()).contains("v/1.png: not found"));
    }
}
