//! Camera path files.

use std::ops::{Bound, RangeInclusive};
use std::path::Path;

use glam::DVec3;
use infonerf_scene::{Keyframe, SceneError, interpolate_keyframes};

use crate::files::json::{self, Node, pair};
use crate::loaders::read_pose;

/// Maximum number of keyframes or frames of a path.
const MAX_FRAMES: usize = 10_000;
/// Default frames per second and length in seconds, for a file without `fps` or `seconds`.
const DEFAULT_FPS: f64 = 20.0;
const DEFAULT_SECONDS: f64 = 4.0;

/// The path of a camera, read from JSON.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    /// The keyframes; never empty.
    pub keyframes: Vec<Keyframe>,
    /// Whether the path returns to its first keyframe.
    pub closed: bool,
    /// Frames per second.
    pub fps: f64,
    /// Number of frames that the file asks for.
    pub frames: usize,
    /// Width and height of the images in pixels, if the file states both.
    pub size: Option<(u32, u32)>,
}

impl CameraPath {
    /// Reads a path. The name of its list of cameras selects one of two forms:
    ///
    /// - `camera_path`, as nerfstudio writes it (`camera_path.json`): every entry is a frame;
    /// - `keyframes`: entries are interpolated ([`interpolate_keyframes`]); the path takes `seconds` (4), and returns
    ///   to its first keyframe if `is_cycle` is true.
    ///
    /// An entry has `camera_to_world`: a row-major 4×4 matrix in the coordinates of the scene's files, with OpenGL's
    /// axes. Either all entries or none have `fov`, the vertical field of view in degrees. The file may also have `fps`
    /// (20), `render_width` and `render_height`. Other fields are ignored.
    ///
    /// # Errors
    /// The file cannot be read, has no such list, more than 10,000 frames, a pose that is not rigid, a number out of range, or
    /// a camera that is not perspective.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let file = json::read(path)?;
        let root = Node::root(path, &file);
        if let Some(kind) = root.find("camera_type") {
            let expected = "\"perspective\"";
            if kind.text(expected)? != "perspective" {
                return Err(kind.error(expected));
            }
        }
        let expected = "a list of 1 to 10000 cameras";
        let (list, complete) = match root.find("camera_path") {
            Some(list) => (list, true),
            None => (root.get("keyframes", &format!("{expected} (or in `camera_path`)"))?, false),
        };
        let items = list.items(expected)?;
        if !(1..=MAX_FRAMES).contains(&items.len()) {
            return Err(list.error(expected));
        }
        let keyframes = items.iter().map(keyframe).collect::<Result<Vec<_>, _>>()?;
        let differs = |keyframe: &Keyframe| keyframe.fov_y.is_some() != keyframes[0].fov_y.is_some();
        if let Some(i) = keyframes.iter().position(differs) {
            let without = if keyframes[i].fov_y.is_some() { 0 } else { i };
            items[without].get("fov", "a field of view, as other cameras of the path have one")?;
        }
        let number = |key: &str, range: RangeInclusive<f64>, expected: &str| {
            root.optional(key, |node| node.within(range, expected))
        };
        let fps = number("fps", 1e-3..=1e3, "0.001 to 1000 frames per second")?.unwrap_or(DEFAULT_FPS);
        let seconds = number("seconds", 1e-3..=1e4, "0.001 to 10000 seconds")?.unwrap_or(DEFAULT_SECONDS);
        let frames = if complete { keyframes.len() } else { (fps * seconds).round().max(1.0) as usize };
        if frames > MAX_FRAMES {
            let expected = format!("at most {MAX_FRAMES} frames at {fps} per second");
            return Err(SceneError::field(path, "seconds", expected, format!("{frames} frames")));
        }
        let expected = "a side of 1 to 8192 pixels";
        let side = |node: Node<'_>| Ok(node.within(1.0..=8192.0, expected)?.round() as u32);
        let size = pair(|_| &root, ["render_width", "render_height"], expected, side)?;
        let is_cycle = root.optional("is_cycle", |node| node.flag("true or false"))?;
        Ok(Self { keyframes, closed: !complete && is_cycle.unwrap_or(false), fps, frames, size })
    }

    /// Returns the path in the coordinates of a scene: `origin`, the scene's origin in its files' coordinates, is subtracted.
    pub fn about(&self, origin: DVec3) -> Self {
        let mut path = self.clone();
        path.keyframes.iter_mut().for_each(|keyframe| keyframe.pose.w_axis -= origin.extend(0.0));
        path
    }

    /// Returns `n` frames along the path.
    pub fn interpolated(&self, n: usize) -> Vec<Keyframe> {
        interpolate_keyframes(&self.keyframes, self.closed, n)
    }
}

fn keyframe(node: &Node<'_>) -> Result<Keyframe, SceneError> {
    let field = "camera_to_world";
    let given = read_pose(node, field)?;
    let pose = given.ok_or_else(|| node.fault(format!("a camera's pose in `{field}`"), "nothing"))?.0;
    let expected = "a vertical field of view between 0 and 180 degrees";
    let range = (Bound::Excluded(0.0), Bound::Excluded(180.0));
    let fov = node.optional("fov", |node| node.within(range, expected))?;
    Ok(Keyframe { pose, fov_y: fov.map(f64::to_radians) })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use serde_json::{Value, json};

    use super::*;
    use crate::loaders::testing::pose;
    use infonerf_procedural::train_cameras;

    /// Checks that exported coordinates minus the origin are the scene's.
    #[test]
    fn paths_far_from_the_origin_of_the_world() {
        let exact = train_cameras(8)[0].to_world;
        let origin = DVec3::new(448_262.25, 4_649_776.5, 85.0);
        let keyframe = glam::DMat4::from_translation(origin) * exact;
        let rows = json!(keyframe.transpose().to_cols_array());
        let path = read(&json!({"keyframes": [{"camera_to_world": rows}]})).unwrap().about(origin);
        assert!((path.keyframes[0].pose.w_axis - exact.w_axis).length() < 1e-8, "{path:?}");
    }

    fn read(value: &Value) -> Result<CameraPath, SceneError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("path.json");
        fs::write(&path, value.to_string()).unwrap();
        CameraPath::read(&path)
    }

    fn entry(index: usize) -> Value {
        json!({"camera_to_world": pose(index), "fov": 50.0, "aspect": 1.5})
    }

    #[test]
    fn nerfstudio_frames_are_taken_as_they_are() {
        let path = read(&json!({
            "keyframes": [{"matrix": "[1,0,0,0]", "fov": 50}], "camera_type": "perspective", "render_height": 60,
            "render_width": 90, "fps": 24, "seconds": 4, "is_cycle": true, "smoothness_value": 0.5,
            "camera_path": [entry(0), entry(1), entry(2)],
        }))
        .unwrap();
        assert_eq!((path.frames, path.fps, path.size, path.closed), (3, 24.0, Some((90, 60)), false));
        for (i, frame) in path.interpolated(path.frames).iter().enumerate() {
            assert!(frame.pose.abs_diff_eq(train_cameras(8)[i].to_world, 1e-12));
            assert!((frame.fov_y.unwrap().to_degrees() - 50.0).abs() < 1e-9);
        }
    }

    #[test]
    fn keyframes_are_interpolated() {
        let bare = |i| json!({"camera_to_world": pose(i)});
        let file = json!({"keyframes": [bare(0), bare(1)], "seconds": 2.0, "fps": 10, "is_cycle": true});
        let path = read(&file).unwrap();
        assert_eq!((path.frames, path.closed, path.size, path.keyframes[0].fov_y), (20, true, None, None));
        let frames = path.interpolated(20);
        assert!(frames[10].pose.abs_diff_eq(train_cameras(8)[1].to_world, 1e-9));
        let path = read(&json!({"keyframes": [bare(0)]})).unwrap();
        assert_eq!((path.frames, path.fps, path.closed), (80, 20.0, false));
    }

    #[test]
    fn faults_name_the_field() {
        let cameras = [entry(0), entry(1)];
        let whole = json!({"camera_type": "perspective", "fps": 24, "render_width": 8, "render_height": 8, "camera_path": cameras});
        let cases = [
            ("/camera_path", json!([]), "`camera_path`: expected a list of 1 to 10000 cameras"),
            ("/camera_path", Value::Null, "`keyframes`: expected a list of 1 to 10000 cameras (or in `camera_path`)"),
            ("/camera_path", json!(3), "`camera_path`: expected a list"),
            ("/camera_path/1", json!({}), "`camera_path[1]`: expected a camera's pose in `camera_to_world`"),
            ("/camera_path/1/camera_to_world", json!([1, 2]), "`camera_path[1].camera_to_world`: expected a 4×4 rigid"),
            ("/camera_path/1/camera_to_world/0", json!(5), "`camera_path[1].camera_to_world[0]`: expected 4"),
            ("/camera_path/1/fov", json!(180), "`camera_path[1].fov`: expected a vertical field of view"),
            ("/camera_path/1/fov", Value::Null, "`camera_path[1].fov`: expected a field of view, as other"),
            ("/camera_path/0/fov", Value::Null, "`camera_path[0].fov`: expected a field of view, as other"),
            ("/fps", json!(0), "`fps`"),
            ("/fps", json!(1e6), "`fps`"),
            ("/render_width", json!(1e9), "`render_width`: expected a side"),
            ("/render_width", Value::Null, "expected a side of 1 to 8192 pixels next to `render_height`"),
            ("/camera_type", json!("fisheye"), "`camera_type`: expected \"perspective\""),
        ];
        for (pointer, value, expected) in cases {
            let mut changed = whole.clone();
            *changed.pointer_mut(pointer).unwrap() = value;
            let text = read(&changed).unwrap_err().to_string();
            assert!(text.contains(expected) && !text.contains('\n'), "{pointer}: {text}");
        }
        let long = read(&json!({"keyframes": [entry(0)], "fps": 1000, "seconds": 11})).unwrap_err().to_string();
        assert!(long.contains("`seconds`: expected at most 10000 frames at 1000 per second, found 11000"), "{long}");
        assert!(CameraPath::read(Path::new("no/path.json")).unwrap_err().to_string().contains("no/path.json"));
    }
}
