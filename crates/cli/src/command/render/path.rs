//! Cameras along a path, which is built in or read from a file.

use std::path::Path;

use anyhow::{Result, ensure};
use glam::DMat4;
use infonerf_dataset::CameraPath;
use infonerf_scene::{
    Backdrop, Camera, Keyframe, Scene, figure_eight, interpolate_views, orbit, resized_dimensions, spiral,
};

/// Number of frames of a built-in path; `FPS` is the number that is shown per second.
pub(super) const FRAMES: u32 = 60;
const FPS: f64 = 20.0;

pub(super) struct Route {
    /// Name of the path's animations.
    pub(super) name: String,
    pub(super) fps: f64,
    poses: Poses,
}

enum Poses {
    /// Function that computes any number of poses from the training cameras and the scene.
    BuiltIn(fn(&[Camera], &Scene, usize) -> Vec<DMat4>),
    File(CameraPath),
}

impl Route {
    /// Returns the built-in path called `name`, or reads the path from the file `name`.
    pub(super) fn read(name: &str) -> Result<Self> {
        let poses: fn(&[Camera], &Scene, usize) -> Vec<DMat4> = match name {
            "orbit" => |cameras, scene, n| orbit(cameras, scene.backdrop == Backdrop::Unknown, n),
            "spiral" => |cameras, scene, n| spiral(cameras, (scene.space.near.into(), scene.space.far.into()), n),
            "figure-eight" => |cameras, _, n| figure_eight(cameras, n),
            "interpolate" => |cameras, _, n| interpolate_views(cameras, n),
            file => {
                let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
                let expected = "orbit, spiral, figure-eight, interpolate or a JSON file with camera poses";
                ensure!(Path::new(file).exists(), "--path {file}: not found; expected {expected}");
                let path = CameraPath::read(Path::new(file))?;
                return Ok(Self { name, fps: path.fps, poses: Poses::File(path) });
            }
        };
        Ok(Self { name: name.to_owned(), fps: FPS, poses: Poses::BuiltIn(poses) })
    }

    /// Returns the [`camera`] of each frame along the path. `size` is the longest side of the pictures.
    pub(super) fn cameras(&self, scene: &Scene, frames: Option<u32>, size: Option<u32>) -> Vec<Camera> {
        let training = scene.training_cameras();
        let (frames, of_file): (Vec<Keyframe>, _) = match &self.poses {
            Poses::BuiltIn(poses) => {
                let poses = poses(&training, scene, frames.unwrap_or(FRAMES) as usize);
                (poses.into_iter().map(|pose| Keyframe { pose, fov_y: None }).collect(), None)
            }
            Poses::File(path) => {
                let path = path.about(scene.origin);
                (path.interpolated(frames.map_or(path.frames, |frames| frames as usize)), path.size)
            }
        };
        frames.into_iter().map(|frame| camera(&training[0], of_file, size, frame)).collect()
    }
}

/// Returns the camera of a frame: with the intrinsics and lens of `like`, or, where the file has a field of view or a
/// size, a pinhole with square pixels and the vertical field of view of the file or of `like`.
fn camera(like: &Camera, of_file: Option<(u32, u32)>, longest: Option<u32>, frame: Keyframe) -> Camera {
    let (width, height) = of_file.unwrap_or((like.width, like.height));
    let (width, height) = longest.map_or((width, height), |longest| resized_dimensions(width, height, longest));
    if of_file.is_none() && frame.fov_y.is_none() {
        return like.resized(width, height).with_pose(frame.pose);
    }
    let tangent = frame.fov_y.map_or(0.5 * f64::from(like.height) / like.fy, |fov_y| (0.5 * fov_y).tan());
    let focal = 0.5 * f64::from(height) / tangent;
    let centre = [0.5 * f64::from(width), 0.5 * f64::from(height)];
    Camera::pinhole((width, height), [focal, focal], centre, frame.pose)
}

#[cfg(test)]
mod tests {
    use infonerf_procedural::train_cameras;

    use super::*;

    #[test]
    fn fields_of_view_are_vertical() {
        let like = &train_cameras(40)[0];
        let frame = |fov_y| Keyframe { pose: like.to_world, fov_y };
        assert_eq!(camera(like, None, None, frame(None)), *like);
        let small = camera(like, None, Some(20), frame(None));
        assert_eq!((small.width, small.height, small.fx), (20, 20, 0.5 * like.fx));
        let wide = camera(like, Some((90, 60)), None, frame(Some(std::f64::consts::FRAC_PI_2)));
        assert_eq!((wide.width, wide.height, wide.cx), (90, 60, 45.0));
        assert!((wide.fx - 30.0).abs() < 1e-9 && wide.fx == wide.fy);
        // Another aspect ratio keeps the vertical field of view.
        let cropped = camera(like, Some((30, 60)), None, frame(None));
        assert!((cropped.fy - 1.5 * like.fy).abs() < 1e-9 && cropped.fx == cropped.fy);
        assert_eq!(camera(like, Some((90, 60)), Some(45), frame(None)).height, 30);
    }
}
