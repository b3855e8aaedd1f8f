//! The Blender format of NeRF's synthetic scenes: `transforms_train.json`, `transforms_test.json`.

use std::path::Path;

use glam::Vec3;
use infonerf_scene::image::has_transparency;
use infonerf_scene::select::published;
use infonerf_scene::{Aabb, Camera, Format, Layout, SceneError, SceneRequest, Space};

use super::transforms::{Transforms, read_transforms, transforms};
use crate::capture::{Estimate, Found, StatedExtent, hold_out};
use crate::files::json;
use crate::frame::{Frame, Intrinsics, cameras_of, numbered};

pub(super) const MARKER: &str = "transforms_train.json";

/// Near and far of NeRF's synthetic scenes.
const RANGE: (f32, f32) = (2.0, 6.0);
/// Half the edge of the cube that holds each of NeRF's synthetic scenes, about the origin.
const HALF_EDGE: f32 = 1.5;
/// Distances of the cameras of NeRF's synthetic scenes from the origin: 4.0311, up to rounding.
const DISTANCES: std::ops::RangeInclusive<f64> = 4.0..=4.06;

/// Reads a folder in Blender's format. Test views come from `transforms_test.json`, or from `transforms_val.json` if that
/// is missing; without any, every eighth training view is held out.
///
/// Optional fields extend the format: `near` and `far`, `aabb`, and in a frame `ray_depth_file_path`, an `.npy` file of
/// exact distances. Without them, NeRF's synthetic scenes have near 2, far 6 and a box of ±1.5. For others these are
/// estimated from the cameras, with a warning: as in any capture, or as of one object on a transparent background.
pub(super) fn read<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Found<'a>, SceneError> {
    let mut train = read_transforms(&dir.join(MARKER))?;
    let (test, val) = (dir.join("transforms_test.json"), dir.join("transforms_val.json"));
    let test = if !test.is_file() && val.is_file() { val } else { test };
    let mut warnings = std::mem::take(&mut train.warnings);
    let cameras = cameras_of(&train.frames)?;
    let first = train.frames.iter().find(|frame| frame.image.is_file());
    let transparent = first.map(|frame| has_transparency(&frame.image)).transpose()?;
    let (extent, estimated) = extent(&train, &cameras, transparent);
    warnings.extend(estimated);
    let (mut train, mut tested) = (train.frames, Vec::new());
    if test.is_file() {
        let read = transforms(&test, &json::read(&test)?)?;
        warnings.extend(read.warnings);
        tested = read.frames;
    }
    if tested.is_empty() {
        (train, tested) = hold_out(train, &request.test);
        (train, tested) = (numbered(train), numbered(tested));
        if !tested.is_empty() {
            let text =
                "transforms_test.json is missing or has no views: every eighth training view is held out for test";
            warnings.push(text.into());
        }
    }
    let selections = published::synthetic(&cameras_of(&train)?);
    Ok(Found { warnings, selections, ..Found::new(dir, Format::Blender, train, tested, extent) })
}

/// Returns the known extent, and a warning if parts of it have to be estimated.
fn extent(train: &Transforms, cameras: &[Camera], transparent: Option<bool>) -> (StatedExtent, Option<String>) {
    let bounds = train.bounds.or(train.cube);
    if (train.range.is_some() && train.bounds.is_some()) || is_published(&train.frames, cameras, transparent) {
        let cube = Aabb::cube(Vec3::ZERO, HALF_EDGE);
        let mut space = Space::known(cameras, RANGE, cube).with(train.range, train.bounds);
        if train.bounds.is_some() && space.layout == Layout::Object {
            let centre = space.bounds.centre();
            space = space.centred(centre, cameras);
        }
        return (StatedExtent::Known(Box::new(space)), None);
    }
    let transparent = transparent == Some(true) && Layout::of(cameras) == Layout::Object;
    let missing = match (train.range, bounds) {
        (None, None) => "near, far and aabb, which are",
        (None, Some(_)) => "near and far, which are",
        (Some(_), _) => "aabb, which is",
    };
    let warning =
        format!("{MARKER} is not one of NeRF's synthetic scenes and has no {missing} estimated from the cameras");
    let estimate = Estimate { range: train.range, bounds, transparent, ..Estimate::default() };
    (StatedExtent::Estimated(estimate), Some(warning))
}

/// Returns whether the frames are from NeRF's synthetic scenes: the first image, if it exists, has transparent pixels,
/// all cameras are 4.03 from the origin, and a field of view is the only intrinsic parameter.
fn is_published(frames: &[Frame], cameras: &[Camera], transparent: Option<bool>) -> bool {
    transparent != Some(false)
        && frames.iter().all(|frame| matches!(frame.intrinsics, Intrinsics::Fov(_, None)))
        && cameras.iter().all(|camera| DISTANCES.contains(&camera.position_f64().length()))
}

#[cfg(test)]
mod tests {
    use super::super::testing::*;
    use glam::{DVec3, Vec3};
    use infonerf_scene::{Backdrop, Format, Layout, SceneRequest, TestProtocol};
    use serde_json::json;
    use std::fs;
    use std::path::PathBuf;

    fn folder() -> (tempfile::TempDir, PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("toy");
        blender(&path, 3, 2);
        (dir, path)
    }

    #[test]
    fn loads_what_was_written() {
        let (_guard, dir) = folder();
        let scene = load(&dir, &request()).unwrap();
        assert_eq!(scene.name, "toy");
        assert_eq!((scene.train.len(), scene.test.len()), (3, 2));
        assert_eq!((scene.space.near, scene.space.far), (2.0, 6.0));
        assert_eq!(scene.train[1].name, "train/r_1");
        assert_eq!(*scene.train[1].image, image(8, 1).to_f32().composite([1.0; 3]));
        let kind = (scene.format, scene.backdrop, scene.space.layout);
        assert_eq!(kind, (Format::Blender, Backdrop::Colour, Layout::Object));
        assert!(scene.space.bounded && scene.warnings.is_empty(), "{:?}", scene.warnings);
        let camera = &scene.train[1].camera;
        assert_eq!(camera.to_world, infonerf_procedural::train_cameras(8)[1].to_world);
        assert!((camera.fx - 4.0 / (0.6911112f64 / 2.0).tan()).abs() < 1e-12);
        assert_eq!(scene.all_train_cameras[1], *camera);
        assert_eq!(scene.train[0].depth, None);
        // The image is composited, then averaged, and its camera is scaled.
        let small = load(&dir, &SceneRequest { image_size: Some(4), ..request() }).unwrap();
        let full = image(8, 0).to_f32();
        let sum: f32 = [0, 1, 8, 9].map(|i| full.pixels[i]).iter().map(|[r, _, _, a]| r * a + 1.0 - a).sum();
        assert!((small.train[0].image.rgb[0][0] - sum / 4.0).abs() < 1e-6);
        assert!((small.train[0].camera.fx - 2.0 / (0.6911112f64 / 2.0).tan()).abs() < 1e-12);
    }

    #[test]
    fn optional_range_and_bounds() {
        let (_guard, dir) = folder();
        let json = dir.join("transforms_train.json");
        edit(&json, "/near", Some(json!(0.5)));
        edit(&json, "/far", Some(json!(9)));
        edit(&json, "/aabb", Some(json!([[-1, -2, -3], [1, 2, 3]])));
        let scene = load(&dir, &request()).unwrap();
        assert_eq!((scene.space.near, scene.space.far), (0.5, 9.0));
        assert_eq!(scene.space.bounds.max, Vec3::new(1.0, 2.0, 3.0));
        edit(&json, "/far", Some(json!(0.5)));
        assert!(message(&dir, &request()).contains("field `far`: expected a distance beyond"));
        edit(&json, "/far", None);
        assert!(message(&dir, &request()).contains("field `far`: expected a distance next to `near`"));
        edit(&json, "/near", None);
        edit(&json, "/aabb", Some(json!([[1, 0, 0], [0, 1, 1]])));
        assert!(message(&dir, &request()).contains("field `aabb`"));
    }

    /// Makes the scene ten times as large and moves it away from the origin.
    #[test]
    fn cameras_elsewhere_give_other_bounds_and_a_warning() {
        let (_guard, dir) = folder();
        for (split, count) in [("train", 3), ("test", 2)] {
            for i in 0..count {
                let camera = moved(&infonerf_procedural::train_cameras(8)[i], |p| p * 10.0 + DVec3::X * 100.0);
                let rows = json!(camera.to_world.transpose().to_cols_array_2d());
                let json = dir.join(format!("transforms_{split}.json"));
                edit(&json, &format!("/frames/{i}/transform_matrix"), Some(rows));
            }
        }
        let scene = load(&dir, &request()).unwrap();
        assert!((scene.space.centre - Vec3::X * 100.0).length() < 0.1, "{}", scene.space.centre);
        assert!((scene.space.bounds.size() - Vec3::splat(30.4)).length() < 1.0, "{:?}", scene.space.bounds);
        assert!((8.0..20.0).contains(&scene.space.near) && (60.0..70.0).contains(&scene.space.far));
        assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("estimated from the cameras"));
    }

    #[test]
    fn the_papers_four_views_have_a_name() {
        let guard = tempfile::tempdir().unwrap();
        blender(guard.path(), 100, 2);
        let chosen = SceneRequest { train: "infonerf-4".parse().unwrap(), test: TestProtocol::Split, ..request() };
        let ids: Vec<_> = load(guard.path(), &chosen).unwrap().train.iter().map(|v| v.id).collect();
        assert_eq!(ids, [26, 86, 2, 55]);
        let unknown = SceneRequest { train: "regnerf-3".parse().unwrap(), ..request() };
        assert!(message(guard.path(), &unknown).contains("one of infonerf-4, found `regnerf-3`"));
    }

    #[test]
    fn faults_of_the_json_name_file_and_field() {
        let identity = |k: f64| json!([[k, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        let place = "/frames/1/transform_matrix";
        let cases = [
            ("/camera_angle_x", None, "`frames[0].camera_angle_x`: expected a horizontal field of view"),
            ("/camera_angle_x", Some(json!(-1)), "found -1"),
            ("/camera_angle_x", Some(json!("wide")), "found \"wide\""),
            ("/camera_angle_x", Some(json!(3.2)), "found 3.2"),
            ("/frames", None, "`frames`: expected a list"),
            ("/frames", Some(json!([])), "`frames`: expected a list of at least one frame with `transform_matrix`"),
            ("/frames", Some(json!(7)), "found 7"),
            ("/frames/1/file_path", None, "`frames[1].file_path`"),
            ("/frames/1/file_path", Some(json!(3)), "`frames[1].file_path`"),
            ("/frames/1/file_path", Some(json!("")), "`frames[1].file_path`"),
            (place, Some(json!([[1, 0, 0, 0]])), "matrix (rotation and translation), found 1 rows"),
            ("/frames/1/transform_matrix/2/3", None, "`frames[1].transform_matrix[2]`"),
            ("/frames/1/transform_matrix/2/3", Some(json!("x")), "`frames[1].transform_matrix[2][3]`"),
            (place, Some(identity(0.0)), "found a singular matrix"),
            (place, Some(identity(2.0)), "found scale or shear"),
            (place, Some(identity(-1.0)), "found a mirrored matrix"),
            ("/frames/1/transform_matrix/3", Some(json!([0, 0, 1, 1])), "found last row"),
            (place, Some(json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [3, 4, 5, 1]])), "found a transposed matrix"),
        ];
        for (pointer, value, expected) in cases {
            let (_guard, dir) = folder();
            edit(&dir.join("transforms_train.json"), pointer, value);
            let text = message(&dir, &request());
            assert!(text.contains("transforms_train.json: field") && text.contains(expected), "{text}");
        }
    }

    /// Without a test file, with an empty one, and with views that have no pose, every eighth view is held out.
    #[test]
    fn views_are_held_out_if_none_are_for_test() {
        let change: [&dyn Fn(&std::path::Path); 3] =
            [&|test| fs::remove_file(test).unwrap(), &|test| edit(test, "/frames", Some(json!([]))), &|test| {
                (0..2).for_each(|i| edit(test, &format!("/frames/{i}/transform_matrix"), None))
            }];
        for change in change {
            let (_guard, dir) = folder();
            change(&dir.join("transforms_test.json"));
            let scene = load(&dir, &request()).unwrap();
            assert_eq!((scene.train.len(), scene.test.len()), (2, 1));
            let is_named =
                scene.warnings.iter().any(|text| text.contains("transforms_test.json is missing or has no views"));
            assert!(is_named, "{:?}", scene.warnings);
            let training = SceneRequest { test: TestProtocol::Training, ..request() };
            assert_eq!(load(&dir, &training).unwrap().train.len(), 3);
            fs::write(dir.join("transforms_test.json"), "{\"frames\": [").unwrap();
            assert!(message(&dir, &request()).contains("transforms_test.json: expected JSON"));
        }
    }

    #[test]
    fn frames_without_a_pose_are_left_out_and_named() {
        let (_guard, dir) = folder();
        let json = dir.join("transforms_train.json");
        edit(&json, "/frames/1/transform_matrix", Some(json!(null)));
        let scene = load(&dir, &request()).unwrap();
        assert_eq!(scene.train.len(), 2);
        let lost = "1 of 3 frames of transforms_train.json left out for want of a pose: train/r_1";
        assert_eq!(scene.warnings, [lost]);
        // Poses as three rows, as sixteen numbers, and with a scaled rotation.
        let pose = pose(0);
        let rows: Vec<_> = pose.as_array().unwrap()[..3].to_vec();
        let flat: Vec<_> = pose.as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap().clone()).collect();
        let exact = &scene.train[0].camera.to_world;
        for matrix in [json!(rows), json!(flat)] {
            edit(&json, "/frames/0/transform_matrix", Some(matrix));
            assert_eq!(load(&dir, &request()).unwrap().train[0].camera.to_world, *exact);
        }
        let mut scaled = rows.clone();
        scaled.iter_mut().for_each(|row| (0..3).for_each(|c| row[c] = json!(1.002 * row[c].as_f64().unwrap())));
        edit(&json, "/frames/0/transform_matrix", Some(json!(scaled)));
        let scene = load(&dir, &request()).unwrap();
        assert!(scene.train[0].camera.to_world.abs_diff_eq(*exact, 1e-9) && scene.warnings[1].contains("corrected"));
    }

    #[test]
    fn depth_next_to_the_images() {
        let (_guard, dir) = folder();
        let json = dir.join("transforms_test.json");
        edit(&json, "/frames/0/ray_depth_file_path", Some(json!("test/d.npy")));
        assert!(message(&dir, &request()).contains("d.npy: not found"));
        let mut depth = vec![f32::INFINITY; 64];
        depth[9] = 3.25;
        crate::files::npy::write(&dir.join("test/d.npy"), &[8, 8], &depth).unwrap();
        assert_eq!(load(&dir, &request()).unwrap().test[0].depth.as_deref(), Some(&depth[..]));
        let resized = load(&dir, &SceneRequest { image_size: Some(4), ..request() }).unwrap();
        assert_eq!(resized.test[0].depth, None);
        assert_warns(&resized, 0, "exact depths of 1 of 5 views are left out: ");
        crate::files::npy::write(&dir.join("test/d.npy"), &[16, 4], &depth).unwrap();
        assert!(message(&dir, &request()).contains("shape [8, 8]: shape [16, 4]"));
    }
}
