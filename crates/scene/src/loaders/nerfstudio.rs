//! nerfstudio's format: one `transforms.json` with intrinsics, shared or per frame.

use std::collections::HashSet;
use std::path::Path;

use super::assemble::{Parts, assemble};
use super::extent::{capture_extent, hold_out};
use super::frames::{Frame, Split, read_transforms};
use crate::{Camera, Scene, SceneError, SceneRequest};

/// The file that marks this format.
pub(super) const MARKER: &str = "transforms.json";

/// Loads a folder in nerfstudio's format.
///
/// Frames named in the fields `train_filenames` and `test_filenames` are the two pools; without
/// those fields every 8th frame, starting with the first, is held out for test. Poses keep their
/// scale. `near`, `far` and `aabb` are taken from the file where it has them, else from where the
/// cameras are, see [`capture_extent`].
pub(super) fn load(dir: &Path, request: &SceneRequest) -> Result<Scene, SceneError> {
    let path = dir.join(MARKER);
    let transforms = read_transforms(&path)?;
    let cameras: Vec<Camera> = transforms.frames.iter().map(|f| f.camera(1, 1)).collect();
    let (range, bounds) = capture_extent(&cameras);
    let (train, test) = match &transforms.split {
        Some(Split { train, test }) => (
            named(&path, "train_filenames", &transforms.frames, train)?,
            named(&path, "test_filenames", &transforms.frames, test)?,
        ),
        None => hold_out(transforms.frames),
    };
    let parts = Parts {
        dir,
        train,
        test,
        range: transforms.range.unwrap_or(range),
        bounds: transforms.bounds.unwrap_or(bounds),
    };
    assemble(parts, request)
}

/// The frames with the given names, in the order of the file. Every name must be a frame's.
fn named(path: &Path, field: &str, frames: &[Frame], names: &[String]) -> Result<Vec<Frame>, SceneError> {
    let known: HashSet<&str> = frames.iter().map(|f| f.name.as_str()).collect();
    if let Some(unknown) = names.iter().find(|n| !known.contains(n.as_str())) {
        let found = format!("\"{unknown}\"");
        return Err(SceneError::field(path, field, "the file_path of a frame", found));
    }
    let wanted: HashSet<&str> = names.iter().map(String::as_str).collect();
    Ok(frames.iter().filter(|f| wanted.contains(f.name.as_str())).cloned().collect())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use glam::Vec2;
    use serde_json::{Value, json};

    use super::super::testing::*;
    use crate::SceneRequest;

    /// Ten 8×8 views with shared intrinsics.
    fn folder() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("capture");
        fs::create_dir_all(dir.join("images")).unwrap();
        let frames: Vec<Value> = (0..10)
            .map(|i| {
                image(8, i as u8).write_png(&dir.join(format!("images/f_{i}.png"))).unwrap();
                json!({"file_path": format!("images/f_{i}.png"), "transform_matrix": pose(i)})
            })
            .collect();
        let value = json!({"w": 8, "h": 8, "fl_x": 10.0, "fl_y": 11.0, "cx": 4.5, "cy": 3.5,
            "k1": 0.0, "frames": frames});
        let json = dir.join("transforms.json");
        write_json(&json, &value);
        (guard, dir, json)
    }

    #[test]
    fn shared_intrinsics_and_hold_out() {
        let (_guard, dir, json) = folder();
        let scene = load(&dir, &request()).unwrap();
        assert_eq!((scene.train.len(), scene.test.len()), (8, 2));
        assert_eq!(scene.test[1].name, "images/f_8");
        assert_eq!(scene.train[0].name, "images/f_1");
        let camera = &scene.train[0].camera;
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (10.0, 11.0, 4.5, 3.5));
        let centre = camera.project(camera.position() + camera.forward()).unwrap();
        assert!((centre - Vec2::new(4.5, 3.5)).length() < 1e-4);
        // The scene lies about the point that all cameras look at.
        assert!(scene.bounds.centre().length() < 1e-3 && scene.near < 3.0 && scene.far > 5.0);

        edit(&json, "/near", Some(json!(1.0)));
        edit(&json, "/far", Some(json!(2.0)));
        assert_eq!(load(&dir, &request()).unwrap().far, 2.0);
    }

    #[test]
    fn frames_override_intrinsics_and_images_are_resized_with_them() {
        let (_guard, dir, json) = folder();
        edit(&json, "/frames/1/fl_x", Some(json!(20.0)));
        let small = SceneRequest { image_size: Some(4), ..request() };
        let scene = load(&dir, &small).unwrap();
        assert_eq!(scene.train[0].camera.fx, 10.0);
        assert_eq!(scene.train[1].camera.fx, 5.0);
        assert_eq!(scene.train[1].camera.cx, 2.25);
    }

    #[test]
    fn named_splits() {
        let (_guard, dir, json) = folder();
        edit(&json, "/train_filenames", Some(json!(["images/f_3.png", "./images/f_0.png"])));
        edit(&json, "/test_filenames", Some(json!(["images/f_9.png"])));
        let scene = load(&dir, &request()).unwrap();
        let names: Vec<_> = scene.train.iter().map(|v| v.name.as_str()).collect();
        assert_eq!(names, ["images/f_0", "images/f_3"]);
        assert_eq!(scene.test.len(), 1);
        edit(&json, "/test_filenames", Some(json!(["images/f_99.png"])));
        let text = message(&dir, &request());
        assert!(text.contains("`test_filenames`: expected the file_path of a frame"), "{text}");
    }

    #[test]
    fn faults_name_the_field() {
        let cases = [
            ("/k1", Some(json!(0.1)), "`k1`: expected 0 (undistorted images"),
            ("/fl_x", Some(json!(0)), "`fl_x`: expected a positive focal length"),
            ("/fl_x", None, "`camera_angle_x`"),
            ("/w", Some(json!(7.5)), "`w`: expected an image side in whole pixels"),
            ("/w", Some(json!(9)), "f_1.png: expected an image of 9×8 pixels"),
            ("/frames/4/transform_matrix/1/1", Some(json!("x")), "`frames[4].transform_matrix[1][1]`"),
            ("/frames/2/p2", Some(json!(1e-3)), "`frames[2].p2`"),
        ];
        for (pointer, value, expected) in cases {
            let (_guard, dir, json) = folder();
            edit(&json, pointer, value);
            let text = message(&dir, &request());
            assert!(text.contains(expected), "{text}");
        }
    }
}
