//! The format of nerfstudio and instant-ngp: one `transforms.json` with intrinsics, shared or per frame.

use std::collections::HashSet;
use std::path::Path;

use super::assemble::Parts;
use super::extent::{capture_space, hold_out};
use super::frames::{Frame, Split, numbered, present, read_transforms};
use crate::image::dimensions;
use crate::{Camera, Format, SceneError, SceneRequest};

/// The file that marks this format.
pub(super) const MARKER: &str = "transforms.json";

/// What a folder in nerfstudio's or instant-ngp's format says.
///
/// Frames named in the fields `train_filenames` and `test_filenames` are the two pools; without
/// those fields every 8th frame, starting with the first, is held out for test. Frames without their image are left out,
/// with one warning. Poses keep their scale. `near`, `far` and `aabb` are taken from the file where it has them, else
/// from `aabb_scale` and from where the cameras are, see [`capture_space`].
pub(super) fn parts<'a>(dir: &'a Path, _: &SceneRequest) -> Result<Parts<'a>, SceneError> {
    let path = dir.join(MARKER);
    let transforms = read_transforms(&path)?;
    let all: HashSet<String> = transforms.frames.iter().map(|f| f.name.clone()).collect();
    let (frames, warning) = present(transforms.frames);
    // One image tells the size of all that do not state theirs.
    let size = frames.iter().find(|f| f.image.is_file()).map(|f| dimensions(&f.image)).transpose()?;
    let cameras: Vec<Camera> = frames
        .iter()
        .map(|f| match (f.stated_size(), size) {
            (None, Some((width, height))) => f.camera(width, height),
            _ => f.nominal_camera(),
        })
        .collect();
    let mut space = capture_space(&cameras, Vec::new(), Vec::new()).with(transforms.range, transforms.bounds);
    if let (Some(cube), None) = (transforms.cube, transforms.bounds) {
        space.bounds = cube;
    }
    let (train, test) = match &transforms.split {
        Some(Split { train, test }) => (
            named(&path, "train_filenames", &frames, &all, train)?,
            named(&path, "test_filenames", &frames, &all, test)?,
        ),
        None => hold_out(frames),
    };
    let mut parts = Parts::new(dir, Format::Transforms, numbered(train), numbered(test), space);
    parts.warnings.extend(warning);
    Ok(parts)
}

/// The frames with the given names, in the order of the file. Every name must be in `all`, if of a frame without image.
fn named(
    path: &Path,
    field: &str,
    frames: &[Frame],
    all: &HashSet<String>,
    names: &[String],
) -> Result<Vec<Frame>, SceneError> {
    if let Some(unknown) = names.iter().find(|n| !all.contains(*n)) {
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
            ("/k1", Some(json!("x")), "`k1`: expected a distortion coefficient"),
            ("/camera_model", Some(json!("EQUIRECTANGULAR")), "`camera_model`: expected one of SIMPLE_PINHOLE"),
            ("/camera_model", Some(json!(3)), "`camera_model`: expected one of SIMPLE_PINHOLE"),
            ("/is_fisheye", Some(json!(1)), "`is_fisheye`: expected true or false"),
            ("/applied_transform", Some(json!([[1, 0, 0, 0]])), "`applied_transform`: expected a 3×4 matrix"),
            ("/aabb_scale", Some(json!(3)), "`aabb_scale`: expected a power of two"),
            ("/frames/2/mask_path", Some(json!("m.png")), "`frames[0].mask_path`: expected the path of a mask"),
            ("/fl_x", Some(json!(0)), "`fl_x`: expected a positive focal length"),
            ("/fl_x", None, "`camera_angle_x`"),
            ("/w", Some(json!(7.5)), "`w`: expected an image side in whole pixels"),
            ("/w", Some(json!(9)), "f_1.png: expected an image of 9×8 pixels"),
            ("/frames/4/transform_matrix/1/1", Some(json!("x")), "`frames[4].transform_matrix[1][1]`"),
            ("/frames/2/p2", Some(json!(1e9)), "`frames[2].p2`"),
        ];
        for (pointer, value, expected) in cases {
            let (_guard, dir, json) = folder();
            edit(&json, pointer, value);
            let text = message(&dir, &request());
            assert!(text.contains(expected), "{text}");
        }
    }
}
