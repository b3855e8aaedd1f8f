//! Captures that COLMAP has reconstructed: `sparse/0` beside a folder of images.

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};

use glam::Vec3;
use infonerf_scene::image::dimensions;
use infonerf_scene::{Camera, Format, SceneError, SceneRequest};

use super::assemble::Parts;
use super::extent::{capture_space, hold_out};
use super::frames::{Frame, numbered, present, without_extension};
use super::llff::{FOLDERS, list_images};
use super::optics::Intrinsics;
use crate::colmap::{ColmapImage, Reconstruction};

/// Name of this format's file in messages.
pub(super) const MARKER: &str = "sparse/0/cameras.bin (or .txt)";

/// What a folder with a COLMAP reconstruction says.
///
/// Images come from the smallest of `images`, `images_2`, `images_4`, `images_8` that is at least as large as the
/// request (without one: `images`). Those without their image are left out, with one warning. Every 8th by name, starting
/// with the first, is held out for test. The points that training photographs see give bounds, near and far, see
/// [`capture_space`]; of a reconstruction that does not say who sees a point, all do, with a warning.
pub(super) fn parts<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Parts<'a>, SceneError> {
    let read = Reconstruction::read(dir)?;
    let names: Vec<&str> = read.images.iter().map(|i| i.name.as_str()).collect();
    let folder = image_folder(dir, &names, request.image_size)?;
    let reduced = folder.file_name().is_some_and(|name| name != FOLDERS[0]) && folder != dir;
    let mut frames = Vec::new();
    for image in &read.images {
        let Some(mut camera) = read.camera(image) else { continue };
        let path = folder.join(&image.name);
        if reduced && path.is_file() {
            let (width, height) = dimensions(&path)?;
            camera = camera.resized(width, height);
        }
        frames.push(frame(image.name.as_str(), path, &camera));
    }
    let (frames, warning) = present(frames);
    let (train, test) = hold_out(frames, &request.test);
    let names_of_train: HashSet<&str> = train.iter().map(|frame| frame.name.as_str()).collect();
    let is_trained = |image: &&ColmapImage| names_of_train.contains(without_extension(&image.name).as_str());
    let images: Vec<&ColmapImage> = read.images.iter().filter(is_trained).collect();
    let cameras: Vec<Camera> = images.iter().filter_map(|image| read.camera(image)).collect();
    let seen: BTreeSet<u64> = images.iter().flat_map(|image| &image.observations).map(|(_, point)| *point).collect();
    let unseen = !read.points.is_empty() && read.images.iter().all(|image| image.observations.is_empty());
    let known = read.points.iter().filter(|(point, _)| unseen || seen.contains(*point));
    let points: Vec<Vec3> = known.map(|(_, position)| position.as_vec3()).collect();
    let space = capture_space(&cameras, points, read.distances(&images));
    let mut parts = Parts::new(dir, Format::Colmap, numbered(train), numbered(test), space);
    parts.warnings.extend(warning);
    if unseen && !parts.test.is_empty() {
        let text = "the reconstruction does not say who sees a point: those of test photographs shape the space too";
        parts.warnings.push(text.into());
    }
    parts.warnings.extend(without_pose(&folder, &names));
    Ok(parts)
}

/// A warning about the photographs in `folder` of which COLMAP has found no pose, where `names` have one.
fn without_pose(folder: &Path, names: &[&str]) -> Option<String> {
    let all = list_images(folder).ok()?;
    let file_name = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let lost: Vec<String> = all.iter().filter_map(file_name).filter(|name| !names.contains(&name.as_str())).collect();
    let (first, last) = (lost.first()?, lost.last()?);
    Some(format!("{} of {} photographs have no pose, {first} to {last}", lost.len(), all.len()))
}

/// The frame of an image whose camera is known.
pub(super) fn frame(name: &str, image: PathBuf, camera: &Camera) -> Frame {
    Frame {
        id: 0,
        name: without_extension(name),
        image,
        depth: None,
        mask: None,
        pose: camera.to_world,
        lens: camera.lens,
        intrinsics: Intrinsics::Pixels {
            focal: [camera.fx, camera.fy],
            centre: Some([camera.cx, camera.cy]),
            size: Some((camera.width, camera.height)),
        },
    }
}

/// The folder whose images suit a request for longest side `size`.
fn image_folder(dir: &Path, names: &[&str], size: Option<u32>) -> Result<PathBuf, SceneError> {
    let mut best = dir.join(FOLDERS[0]);
    if !best.is_dir() && names.iter().any(|name| dir.join(name).is_file()) {
        return Ok(dir.into());
    }
    let Some(size) = size else { return Ok(best) };
    for folder in FOLDERS.map(|f| dir.join(f)) {
        let Some(first) = names.iter().map(|name| folder.join(name)).find(|path| path.is_file()) else { continue };
        let (width, height) = dimensions(&first)?;
        if width.max(height) >= size {
            best = folder;
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;
    use std::path::Path;

    use glam::{DVec2, DVec3};

    use super::super::testing::*;
    use crate::colmap::testing::{write_binary, write_text};
    use crate::colmap::{ColmapImage, Reconstruction};
    use infonerf_scene::{Backdrop, Camera, Format, Layout, Lens, SceneRequest, TestProtocol};

    /// A ball's points and nine views of `knot` through the lens of a FULL_OPENCV camera; image 8's file is not there.
    fn folder(dir: &Path, text: bool) -> Vec<Camera> {
        let lens = [24.0, 25.0, 10.5, 8.0, 0.1, 0.02, 1e-3, -1e-3, 0.01, 0.05, 0.02, 0.0];
        let guard = tempfile::tempdir().unwrap();
        let line = lens.map(|v| v.to_string()).join(" ");
        fs::write(guard.path().join("cameras.txt"), format!("4 FULL_OPENCV 20 16 {line}\n")).unwrap();
        fs::write(guard.path().join("images.txt"), "1 1 0 0 0 0 0 0 4 x.png\n").unwrap();
        fs::write(guard.path().join("points3D.txt"), "").unwrap();
        let mut all = Reconstruction::read(guard.path()).unwrap();
        let camera = |i: usize| all.cameras[&4].at(infonerf_procedural::train_cameras(8)[i].to_world);
        let cameras: Vec<Camera> = (0..9).map(camera).collect();
        let points: BTreeMap<u64, DVec3> = (0..200)
            .map(|i| (i, DVec3::new((i as f64).sin(), (i as f64 * 1.7).sin(), (i as f64 * 0.6).cos())))
            .collect();
        all.images = (0..9)
            .map(|i| ColmapImage {
                id: i as u32,
                name: format!("v/{i}.png"),
                camera: 4,
                pose: cameras[i].to_world,
                observations: points.keys().map(|&p| (DVec2::ZERO, p)).collect(),
            })
            .collect();
        all.points = points;
        let place = dir.join("sparse/0");
        if text {
            write_text(&place, &all)
        } else {
            write_binary(&place, &all)
        }
        fs::create_dir_all(dir.join("images/v")).unwrap();
        for (i, camera) in cameras[..8].iter().enumerate() {
            write_view(&dir.join(format!("images/v/{i}.png")), camera);
        }
        cameras
    }

    #[test]
    fn a_procedural_scene_round_trips() {
        for text in [false, true] {
            let guard = tempfile::tempdir().unwrap();
            let cameras = folder(guard.path(), text);
            let scene = load(guard.path(), &request()).unwrap();
            assert_eq!((scene.train.len(), scene.test.len(), scene.format), (7, 1, Format::Colmap));
            assert_eq!(scene.train[0].name, "v/1");
            for (view, camera) in scene.train.iter().zip(&cameras[1..]) {
                assert_same_view(view, camera);
            }
            assert_eq!(scene.warnings.len(), 1);
            assert!(scene.warnings[0].contains("1 of 9 frames have no image"), "{:?}", scene.warnings);
            assert_eq!((scene.space.layout, scene.backdrop), (Layout::Object, Backdrop::Colour));
            assert_eq!(scene.space.points.len(), 200);
            assert!((2.0..3.1).contains(&scene.space.near) && (4.9..6.5).contains(&scene.space.far), "{scene:?}");
            assert!((scene.space.bounds.max.x - 1.2).abs() < 0.05);
        }
    }

    /// Neither their cameras nor the points that they alone see.
    #[test]
    fn test_photographs_do_not_shape_the_space() {
        let guard = tempfile::tempdir().unwrap();
        folder(guard.path(), false);
        let place = guard.path().join("sparse/0");
        let mut all = Reconstruction::read(guard.path()).unwrap();
        write_binary(&place, &all);
        let before = load(guard.path(), &request()).unwrap();
        all.images[0].pose.w_axis.x += 20.0;
        for i in 0..100 {
            all.points.insert(1000 + i, DVec3::new(30.0, i as f64, 0.0));
            all.images[0].observations.push((DVec2::ZERO, 1000 + i));
        }
        write_binary(&place, &all);
        let after = load(guard.path(), &request()).unwrap();
        assert!(after.test != before.test && infonerf_scene::Scene { test: before.test.clone(), ..after } == before);
        // Of points that nobody is said to see, all count.
        all.images.iter_mut().for_each(|image| image.observations.clear());
        write_binary(&place, &all);
        let unseen = load(guard.path(), &request()).unwrap();
        assert!(unseen.space.points.len() == 300 && unseen.warnings[1].contains("does not say who sees a point"));
    }

    #[test]
    fn smaller_images_take_their_cameras_with_them() {
        let guard = tempfile::tempdir().unwrap();
        let cameras = folder(guard.path(), false);
        fs::create_dir_all(guard.path().join("images_2/v")).unwrap();
        for (i, camera) in cameras[..8].iter().enumerate() {
            write_view(&guard.path().join(format!("images_2/v/{i}.png")), &camera.resized(10, 8));
        }
        let scene = load(guard.path(), &SceneRequest { image_size: Some(10), ..request() }).unwrap();
        assert_same_view(&scene.train[0], &cameras[1].resized(10, 8));
        assert!(!scene.train[0].camera.lens.is_perspective());
    }

    #[test]
    fn photographs_without_a_pose_are_counted() {
        let guard = tempfile::tempdir().unwrap();
        folder(guard.path(), false);
        fs::write(guard.path().join("images/lost.png"), []).unwrap();
        let warnings = super::parts(guard.path(), &request()).unwrap().warnings;
        assert!(warnings[1].contains("1 of 1 photographs have no pose, lost.png to lost.png"), "{warnings:?}");
    }

    #[test]
    fn nothing_is_held_out_where_training_views_are_tested() {
        let guard = tempfile::tempdir().unwrap();
        folder(guard.path(), false);
        let scene = load(guard.path(), &SceneRequest { test: TestProtocol::Training, ..request() }).unwrap();
        assert_eq!((scene.train.len(), &scene.test), (8, &scene.train));
    }

    #[test]
    fn faults() {
        let guard = tempfile::tempdir().unwrap();
        let cameras = folder(guard.path(), false);
        write_view(&guard.path().join("images/v/3.png"), &cameras[3].resized(10, 8));
        assert!(message(guard.path(), &request()).contains("3.png: expected an image of 20×16 pixels"));
        fs::remove_dir_all(guard.path().join("images")).unwrap();
        assert!(message(guard.path(), &request()).contains("v/1.png: not found"));
    }

    #[test]
    #[ignore = "needs …/shared/data"]
    fn the_room_is_seen_from_within_or_around() {
        let dir = shared_data("colmap_room");
        let parts = super::parts(&dir, &request()).unwrap();
        let space = &parts.space;
        eprintln!("{:?} near {} far {} {:?} up {}", space.layout, space.near, space.far, space.bounds, space.up);
        assert_eq!(parts.train.len() + parts.test.len(), 41);
        assert!(!parts.train[0].lens.is_perspective() && parts.train[0].lens != Lens::PERSPECTIVE);
        assert!(space.near > 0.0 && space.near < space.far);
    }
}
