//! The format of nerfstudio and instant-ngp: one `transforms.json` with intrinsics, shared or per frame.

use std::collections::HashSet;
use std::path::Path;

use infonerf_scene::{Format, SceneError, SceneRequest, TestProtocol};

use super::transforms::{Split, Transforms, read_transforms};
use crate::capture::{Estimate, Found, StatedExtent, hold_out};
use crate::frame::{Frame, numbered, with_images};

pub(super) const MARKER: &str = "transforms.json";

/// Reads a folder in nerfstudio's or instant-ngp's format.
///
/// Frames named in the fields `train_filenames` and `test_filenames` (or `val_filenames`) are the two pools. One that both
/// name is for test, and a missing field stands for the other frames. Without those fields, or if no test frame is named,
/// every 8th frame, starting with the first, is held out for test. Frames without their image or pose are left out, with a
/// warning. Poses keep their scale. `near` and `far`, and the box from `aabb` or `aabb_scale`, are read from the file, or
/// else estimated from the training cameras.
pub(super) fn read<'a>(dir: &'a Path, request: &SceneRequest) -> Result<Found<'a>, SceneError> {
    let path = dir.join(MARKER);
    let Transforms { frames, lost, warnings, range, bounds, cube, split } = read_transforms(&path)?;
    let estimate = Estimate { range, bounds: bounds.or(cube), ..Estimate::default() };
    let all: HashSet<String> = frames.iter().map(|f| f.name.clone()).chain(lost).collect();
    let mut found = match &split {
        Some(Split { train, test, test_field }) => {
            let (frames, warning) = with_images(frames);
            for (field, names) in [("train_filenames", train), (*test_field, test)] {
                if let Some(unknown) = names.iter().flatten().find(|name| !all.contains(*name)) {
                    return Err(SceneError::field(&path, field, "the file_path of a frame", format!("\"{unknown}\"")));
                }
            }
            let mut warnings = Vec::from_iter(warning);
            let has = |list: &Option<Vec<String>>, frame: &Frame| Some(list.as_ref()?.contains(&frame.name));
            // Without a list, the frames that the other list does not name.
            let chosen = |list, other| -> Vec<Frame> {
                let is_chosen = |frame: &&Frame| has(list, frame).unwrap_or(has(other, frame) == Some(false));
                frames.iter().filter(is_chosen).cloned().collect()
            };
            let (mut train, mut test) = (chosen(train, test), chosen(test, train));
            let is_tested = |frame: &Frame| test.iter().any(|other| other.id == frame.id);
            let count = train.iter().filter(|frame| is_tested(frame)).count();
            if count > 0 && count < train.len() && request.test != TestProtocol::Training {
                train.retain(|frame| !is_tested(frame));
                let all = test.len();
                warnings.push(format!(
                    "{count} of {all} frames in `{test_field}` also in `train_filenames`: not trained on"
                ));
            }
            if test.is_empty() {
                (train, test) = hold_out(train, &request.test);
                let text = format!("{test_field} names no image: every eighth training frame is held out for test");
                warnings.extend((!test.is_empty()).then_some(text));
            }
            let extent = StatedExtent::Estimated(estimate);
            Found { warnings, ..Found::new(dir, Format::Transforms, numbered(train), numbered(test), extent) }
        }
        None => Found::captured(dir, Format::Transforms, frames, &request.test, estimate),
    };
    if found.train.is_empty() {
        return Err(SceneError::field(&path, "train_filenames", "at least one frame with its image", "none"));
    }
    found.warnings.extend(warnings);
    Ok(found)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use glam::Vec2;
    use serde_json::json;

    use super::super::testing::*;
    use infonerf_scene::{Camera, Image, Lens, Scene, SceneRequest, View};

    /// Returns ten 8×8 views with shared intrinsics.
    fn folder() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let guard = tempfile::tempdir().unwrap();
        let (dir, json) = (guard.path().to_owned(), guard.path().join("transforms.json"));
        let frames = frames(&dir, "images", 10, 0);
        let shared = json!({"w": 8, "h": 8, "fl_x": 10.0, "fl_y": 11.0, "cx": 4.5, "cy": 3.5, "k1": 0.0});
        write_json(&json, &shared);
        edit(&json, "/frames", Some(json!(frames)));
        (guard, dir, json)
    }

    #[test]
    fn shared_intrinsics_and_hold_out() {
        let (_guard, dir, json) = folder();
        edit(&json, "/frames/1/fl_x", Some(json!(20.0)));
        let scene = load(&dir, &request()).unwrap();
        assert_eq!((scene.train.len(), scene.test.len()), (8, 2));
        assert_eq!((scene.test[1].name.as_str(), scene.train[0].name.as_str()), ("images/r_8", "images/r_1"));
        let camera = &scene.train[1].camera;
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (10.0, 11.0, 4.5, 3.5));
        let centre = camera.project(camera.position() + camera.forward()).unwrap();
        assert!((centre - Vec2::new(4.5, 3.5)).length() < 1e-4);
        // The scene lies about the point that all cameras look at.
        assert!(scene.space.bounds.centre().length() < 1e-3 && scene.space.near < 3.0 && scene.space.far > 5.0);
        edit(&json, "/frames/2/distortion_params", Some(json!([0.1, 0.02, 0.0, 0.0, 0.003, 0.004])));
        let lens = load(&dir, &request()).unwrap().train[1].camera.lens;
        assert_eq!(lens, Lens::radial_tangential([0.1, 0.02, 0.0, 0.0], [0.003, 0.004]));
        edit(&json, "/frames/2/distortion_params/5", Some(json!(1e300)));
        let text = message(&dir, &request());
        assert!(text.contains("distortion_params`: expected six distortion coefficients up to 1e6"), "{text}");
        edit(&json, "/frames/2/distortion_params", None);
        // Intrinsics of a frame come first, and are resized with the image.
        let small = load(&dir, &SceneRequest { image_size: Some(4), ..request() }).unwrap();
        assert_eq!([small.train[0].camera.fx, small.train[1].camera.fx, small.train[1].camera.cx], [10.0, 5.0, 2.25]);
        edit(&json, "/near", Some(json!(1.0)));
        edit(&json, "/far", Some(json!(2.0)));
        assert_eq!(load(&dir, &request()).unwrap().space.far, 2.0);
    }

    /// States angles for one frame, which come before the focal lengths of all.
    #[test]
    fn fields_of_view_keep_the_principal_point() {
        let (_guard, dir, json) = folder();
        edit(&json, "/frames/1/camera_angle_x", Some(json!(0.5)));
        edit(&json, "/frames/1/camera_angle_y", Some(json!(0.6)));
        let assert_centre = |cx: f64| {
            let camera = load(&dir, &request()).unwrap().train[0].camera.clone();
            assert_eq!((camera.fx, camera.fy, camera.cx), (4.0 / 0.25f64.tan(), 4.0 / 0.3f64.tan(), cx));
        };
        assert_centre(4.5);
        ["/w", "/h"].iter().for_each(|key| edit(&json, key, None));
        let text = message(&dir, &request());
        assert!(text.contains("`w`: expected an image side in pixels next to `camera_angle_x` and `cx`"), "{text}");
        ["/cx", "/cy"].iter().for_each(|key| edit(&json, key, None));
        assert_centre(4.0);
    }

    #[test]
    fn named_splits() {
        let (_guard, dir, json) = folder();
        edit(&json, "/train_filenames", Some(json!(["images/r_3.png", "./images/r_0.png"])));
        edit(&json, "/test_filenames", Some(json!(["images/r_9.png"])));
        let scene = load(&dir, &request()).unwrap();
        let names: Vec<_> = scene.train.iter().map(|v| v.name.as_str()).collect();
        assert_eq!(names, ["images/r_0", "images/r_3"]);
        assert_eq!(scene.test.len(), 1);
        // A split names a frame without a pose.
        edit(&json, "/frames/3/transform_matrix", Some(json!(null)));
        assert_eq!(load(&dir, &request()).unwrap().train.len(), 1);
        edit(&json, "/test_filenames", Some(json!(["images/r_99.png"])));
        let text = message(&dir, &request());
        assert!(text.contains("`test_filenames`: expected the file_path of a frame"), "{text}");
        for tested in [Some(json!([])), None] {
            edit(&json, "/test_filenames", tested);
            edit(&json, "/val_filenames", Some(json!(["images/r_5.png"])));
            assert_eq!(load(&dir, &request()).unwrap().test[0].name, "images/r_5");
        }
        edit(&json, "/val_filenames", Some(json!([])));
        edit(&json, "/train_filenames", Some(json!(["images/r_0.png", "images/r_5.png"])));
        let scene = load(&dir, &request()).unwrap();
        assert_eq!((scene.test[0].name.as_str(), scene.train.len()), ("images/r_0", 1));
        let is_named = scene.warnings.iter().any(|text| text.starts_with("val_filenames names no image"));
        assert!(is_named, "{:?}", scene.warnings);
        edit(&json, "/train_filenames", Some(json!([])));
        assert!(message(&dir, &request()).contains("`train_filenames`: expected at least one frame"));
        // Without a list the other frames are meant; what both lists name is for test.
        edit(&json, "/frames/3/transform_matrix", Some(pose(3)));
        edit(&json, "/val_filenames", None);
        let names = |upto: usize| json!((0..upto).map(|i| format!("images/r_{i}.png")).collect::<Vec<_>>());
        for (trained, tested, train) in [(None, Some(4), 6), (Some(7), None, 7), (Some(10), Some(3), 7)] {
            edit(&json, "/train_filenames", trained.map(names));
            edit(&json, "/test_filenames", tested.map(names));
            let scene = load(&dir, &request()).unwrap();
            assert_eq!((scene.train.len(), scene.test.len()), (train, 10 - train));
            let is_shared =
                scene.warnings.iter().any(|text| text.starts_with("3 of 3 frames in `test_filenames` also in"));
            assert_eq!(is_shared, trained == Some(10));
        }
    }

    /// Gives each frame a lens of its own; the image of one frame is missing.
    #[test]
    fn every_lens_round_trips() {
        let (k, p, full) = ([0.05, -0.02, 0.01, 0.003], [1e-3, -2e-3], [0.2, 0.1, 0.01, 0.1, 0.05, 0.002]);
        let simple = Lens::radial_tangential([k[0], 0.0, 0.0, 0.0], [0.0; 2]);
        let [bent, rational] = [Lens::radial_tangential(k, p), Lens::rational(full, p)];
        let [even, fisheye] = [[0.0; 4], k].map(Lens::fisheye);
        let guard = tempfile::tempdir().unwrap();
        let (dir, json) = (guard.path(), guard.path().join("transforms.json"));
        fs::create_dir_all(dir.join("images")).unwrap();
        let view = |(i, lens): (usize, Lens)| {
            let (focal, pose) = (20.0 + i as f64, infonerf_procedural::train_cameras(8)[i].to_world);
            let camera = Camera::pinhole((18, 14), [focal, focal + 0.5], [8.75, 7.5], pose).with_lens(lens);
            if i != 3 {
                write_view(&dir.join(format!("images/r_{i}.png")), &camera);
            }
            View::new(i, format!("images/r_{i}"), camera, Image::filled(18, 14, [0.0; 3]))
        };
        let lenses = [Lens::PERSPECTIVE, simple, bent, bent, rational, even, fisheye];
        let views: Vec<View> = lenses.into_iter().enumerate().map(view).collect();
        write_json(&json, &crate::transforms(&Scene { train: views.clone(), ..Scene::default() }));
        // A lens without a model, and what instant-ngp writes: paths without extension, its own box, and its fisheye.
        for key in ["near", "far", "aabb", "train_filenames", "test_filenames"] {
            edit(&json, &format!("/{key}"), None);
        }
        [1, 6].iter().for_each(|frame| edit(&json, &format!("/frames/{frame}/camera_model"), None));
        edit(&json, "/aabb_scale", Some(json!(4)));
        edit(&json, "/frames/6/is_fisheye", Some(json!(true)));
        edit(&json, "/frames/2/file_path", Some(json!("./images/r_2")));
        let scene = load(dir, &request()).unwrap();
        assert_eq!((scene.train.len(), scene.test.len(), scene.warnings.len()), (5, 1, 1));
        assert_warns(&scene, 0, "1 of 7 frames without an image, such as ");
        assert!((scene.space.bounds.size().x - 4.0 / 0.33).abs() < 1e-4, "instant-ngp's box");
        // Cameras that are written load back.
        write_json(&json, &crate::transforms(&scene));
        let again = load(dir, &request()).unwrap();
        assert_eq!((again.space.range, again.space.bounds), (scene.space.range, scene.space.bounds));
        assert_eq!((again.train.len(), again.test.len(), again.warnings.len()), (5, 1, 0));
        for view in [scene, again].iter().flat_map(|scene| scene.train.iter().chain(&scene.test)) {
            assert_same_view(view, &views[view.name["images/r_".len()..].parse::<usize>().unwrap()].camera);
        }
    }

    #[test]
    fn masks_leave_out_pixels_or_score() {
        let (_guard, dir, json) = folder();
        let mask = |i: u32, black: u32| write_mask(&dir.join(format!("images/m_{i}.png")), (8, 8), |j| j >= black);
        for i in 0..10 {
            mask(i, 7 * i);
            edit(&json, &format!("/frames/{i}/mask_path"), Some(json!(format!("images/m_{i}.png"))));
        }
        let chosen = SceneRequest { train: "0,1".parse().unwrap(), ..request() };
        let scene = load(&dir, &chosen).unwrap();
        let view = &scene.train[1];
        let kept = view.mask.as_deref().unwrap();
        assert!(!kept[13] && kept[14] && kept.len() == 64 && view.valid == view.mask);
        // The photograph is left as it is.
        assert_eq!(*view.image, image(8, 2).to_f32().composite([1.0; 3]));
        assert_warns(
            &scene,
            0,
            "in 3 of 4 views masks leave out pixels: those pixels are neither trained on nor measured",
        );
        let score = SceneRequest { masks: infonerf_scene::MaskUse::Score, ..chosen.clone() };
        let scored = load(&dir, &score).unwrap();
        assert!(scored.train[1].valid.is_none() && scored.train[1].mask == view.mask && scored.warnings.is_empty());
        // Views without a valid pixel are left out; without another training view that is an error.
        mask(8, 64);
        let scene = load(&dir, &chosen).unwrap();
        assert_eq!((scene.test.len(), scene.test[0].id), (1, 0));
        assert_eq!(scene.warnings[0], "not tested, as masks leave no pixel: test views images/r_8");
        mask(1, 64);
        let scene = load(&dir, &chosen).unwrap();
        assert_eq!((scene.train.len(), scene.train[0].id), (1, 1));
        assert_warns(&scene, 0, "not trained on, as masks leave no pixel: training views images/r_1");
        mask(2, 64);
        assert!(message(&dir, &chosen).contains("m_1.png: expected a mask that leaves pixels to train on"));
        assert_eq!(load(&dir, &score).unwrap().test.len(), 2);
        fs::remove_file(dir.join("images/m_1.png")).unwrap();
        assert!(message(&dir, &chosen).contains("m_1.png: not found"));
    }

    /// States intrinsics for larger images than the files.
    #[test]
    fn cameras_are_scaled_to_their_images() {
        let (_guard, dir, json) = folder();
        let whole = load(&dir, &request()).unwrap();
        for (key, value) in [("w", 32.0), ("h", 32.0), ("fl_x", 40.0), ("fl_y", 44.0), ("cx", 18.0), ("cy", 14.0)] {
            edit(&json, &format!("/{key}"), Some(json!(value)));
        }
        let scaled = load(&dir, &request()).unwrap();
        assert_eq!(scaled.warnings, ["the cameras are for images of 32×32 pixels, these have 8×8: they are scaled"]);
        assert!(Scene { warnings: Vec::new(), ..scaled } == whole);
        image(9, 1).write_png(&dir.join("images/r_3.png")).unwrap();
        assert_eq!(load(&dir, &request()).unwrap().train[2].image.width, 8);
    }

    #[test]
    fn faults_name_the_field() {
        let cases = [
            ("/k1", Some(json!("x")), "`k1`: expected a distortion coefficient"),
            ("/camera_model", Some(json!("EQUIRECTANGULAR")), "`camera_model`: expected one of SIMPLE_PINHOLE"),
            ("/camera_model", Some(json!(3)), "`camera_model`: expected one of SIMPLE_PINHOLE"),
            ("/is_fisheye", Some(json!(1)), "`is_fisheye`: expected true or false"),
            ("/is_fisheye", Some(json!(true)), "`is_fisheye`: expected false next to the perspective `camera_model`"),
            ("/cx", Some(json!(null)), "`cx`: expected a position in pixels next to `cy`"),
            ("/h", None, "`h`: expected an image side in pixels next to `w`"),
            ("/aabb_scale", Some(json!(0)), "`aabb_scale`: expected a power of two"),
            ("/frames/2/mask_path", Some(json!("m.png")), "m.png: not found"),
            ("/fl_x", Some(json!(0)), "`fl_x`: expected a positive focal length"),
            ("/fl_x", None, "`fl_x`: expected a focal length in pixels next to `fl_y`"),
            ("/w", Some(json!(7.5)), "`w`: expected an image side in whole pixels"),
            ("/w", Some(json!(9)), "r_1.png: expected an image of 9×8 pixels"),
            ("/frames/4/transform_matrix/1/1", Some(json!("x")), "`frames[4].transform_matrix[1][1]`"),
            ("/frames/2/p2", Some(json!(1e9)), "`frames[2].p2`"),
        ];
        for (pointer, value, expected) in cases {
            let (_guard, dir, json) = folder();
            edit(&json, "/camera_model", Some(json!("OPENCV")));
            edit(&json, pointer, value);
            let text = message(&dir, &request());
            assert!(text.contains(expected), "{text}");
        }
    }
}
