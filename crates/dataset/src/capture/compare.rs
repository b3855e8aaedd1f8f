//! Check of the given cameras against matches between the photographs.

use glam::{DMat3, DMat4, DVec2, DVec3};
use infonerf_scene::image::{GreyImage, read_rgba, resized_dimensions};
use infonerf_scene::{Camera, SceneError};
use infonerf_sfm::{ImageMatches, Pose, explains, verified_matches};
use rayon::prelude::*;

use super::Capture;
use crate::frame::Frame;

/// Photographs that are matched, at most.
const MAX_IMAGES: usize = 16;
/// Length of a run of photographs with consecutive names, which often overlap; several runs are matched.
const RUN: usize = 4;
/// Longest side of the images that are matched, in pixels.
const SIZE: u32 = 480;
const FEATURES: usize = 1500;
/// Distance of a match from where the cameras expect it, over the longer side, at which they still explain it.
const TOLERANCE: f64 = 8e-3;
/// Fewer matches than this show nothing.
const MIN_MATCHES: usize = 60;
/// Poses are doubted if they explain less than this share of the matches.
const EXPLAINED: f64 = 0.5;
/// Another convention is named if it explains at least this share of the matches.
const CONVINCING: f64 = 0.7;
/// Plausible focal lengths over the longer side of the image: fields of view from 5° to 118°.
const FOCAL_LENGTHS: std::ops::RangeInclusive<f64> = 0.3..=11.5;

/// Compares the cameras of a capture with its photographs: implausible intrinsics, and matches between photographs that
/// the poses do not explain, with the convention that explains more of them. Returns a line for each doubt.
pub(crate) fn compare(capture: &Capture<'_>) -> Result<Vec<String>, SceneError> {
    let mut frames: Vec<&Frame> = capture.found.train.iter().chain(&capture.found.test).collect();
    frames.retain(|frame| frame.image.is_file());
    frames.sort_by_key(|frame| natural(&frame.name));
    frames.dedup_by(|a, b| a.image == b.image);
    let chosen = spread(frames.len());
    let read: Result<Vec<_>, _> = chosen.par_iter().map(|&i| small(frames[i])).collect();
    let (images, cameras): (Vec<GreyImage>, Vec<Camera>) = read?.into_iter().unzip();
    let mut doubts = implausible(&frames, &chosen, &cameras);
    let focal: Vec<f64> = cameras.iter().map(|camera| (camera.fx * camera.fy).sqrt()).collect();
    let matches = verified_matches(&images, &focal, FEATURES);
    let count: usize = matches.iter().map(|pair| pair.pixels.len()).sum();
    if count < MIN_MATCHES {
        return Ok(doubts);
    }
    let poses: Vec<DMat4> = frames.iter().map(|frame| frame.pose).collect();
    let share = |poses: &[DMat4], factor: f64| share(&matches, &cameras, &chosen, poses, factor);
    let given = share(&poses, 1.0);
    if given >= EXPLAINED {
        return Ok(doubts);
    }
    let names: Vec<&str> = frames.iter().map(|frame| frame.name.as_str()).collect();
    let conventions = conventions(&poses, &names).into_iter().map(|(name, poses)| (share(&poses, 1.0), name));
    let mean = focal.iter().sum::<f64>() / focal.len() as f64;
    let longer = f64::from(cameras[0].width.max(cameras[0].height));
    let focal_lengths = [0.5, 0.7, 0.9, 1.15, 1.5, 2.0, 3.0].map(|times| {
        (share(&poses, times * longer / mean), format!("with focal lengths of about {times} image widths"))
    });
    let best = conventions.chain(focal_lengths).max_by(|a, b| a.0.total_cmp(&b.0));
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let advice = match best {
        Some((share, name)) if share >= CONVINCING => format!("{name} they would explain {}", percent(share)),
        _ => "are they of these photographs, and in this order?".to_owned(),
    };
    let (given, images) = (percent(given), chosen.len());
    doubts.push(format!("the cameras explain {given} of {count} matches between {images} photographs: {advice}"));
    Ok(doubts)
}

/// Returns a sort key of a name in which numbers count by their value.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut key = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let end = rest[text..].find(|c: char| !c.is_ascii_digit()).map_or(rest.len(), |digits| text + digits);
        key.push((rest[..text].to_owned(), rest[text..end].parse().unwrap_or(0)));
        rest = &rest[end..];
    }
    key
}

/// Chooses at most [`MAX_IMAGES`] of `count` images: runs of neighbours spread over all.
fn spread(count: usize) -> Vec<usize> {
    if count <= MAX_IMAGES {
        return (0..count).collect();
    }
    let runs = MAX_IMAGES / RUN;
    (0..MAX_IMAGES).map(|i| i / RUN * (count - RUN) / (runs - 1) + i % RUN).collect()
}

/// Reads a small grey image and its camera.
fn small(frame: &Frame) -> Result<(GreyImage, Camera), SceneError> {
    let image = read_rgba(&frame.image)?;
    let (width, height) = (image.width, image.height);
    let size = resized_dimensions(width, height, width.max(height).min(SIZE));
    let image = image.composite_resized(size.0, size.1, [1.0; 3]);
    let grey = GreyImage::luma(size.0 as usize, size.1 as usize, image.rgb.into_iter());
    Ok((grey, frame.camera(width, height).resized(size.0, size.1)))
}

/// Describes focal lengths and principal points that no camera has.
fn implausible(frames: &[&Frame], chosen: &[usize], cameras: &[Camera]) -> Vec<String> {
    let name = |i: usize| &frames[chosen[i]].name;
    let mut doubts = Vec::new();
    let over_longer = |c: &Camera| (c.fx * c.fy).sqrt() / f64::from(c.width.max(c.height));
    if let Some(i) = cameras.iter().position(|c| c.lens.is_perspective() && !FOCAL_LENGTHS.contains(&over_longer(c))) {
        let (name, found) = (name(i), over_longer(&cameras[i]));
        let doubt = "image widths: is it in pixels, and for images of this size?";
        doubts.push(format!("the focal length of {name} is {found:.2} {doubt}"));
    }
    let inside = |c: &Camera| (0.0..=f64::from(c.width)).contains(&c.cx) && (0.0..=f64::from(c.height)).contains(&c.cy);
    if let Some(i) = cameras.iter().position(|c| !inside(c)) {
        doubts.push(format!("the principal point of {} lies outside the image", name(i)));
    }
    doubts
}

/// Returns poses as other programs may mean the given matrices, each with the words that follow "taken as".
fn conventions(given: &[DMat4], names: &[&str]) -> Vec<(String, Vec<DMat4>)> {
    let flip = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
    let each = |change: &dyn Fn(&DMat4) -> DMat4| given.iter().map(change).collect::<Vec<_>>();
    let rolled = |degrees: f64| each(&|pose| *pose * DMat4::from_rotation_z(degrees.to_radians()));
    let mut all = vec![
        ("with OpenCV's axes (y down, z forward)".to_owned(), each(&|pose| *pose * flip)),
        ("as world-to-camera matrices".to_owned(), each(&|pose| pose.inverse())),
        ("as world-to-camera matrices with OpenCV's axes".to_owned(), each(&|pose| pose.inverse() * flip)),
    ];
    all.extend([90.0, 180.0, 270.0].map(|degrees| (format!("with cameras rolled by {degrees}°"), rolled(degrees))));
    let mut as_text: Vec<usize> = (0..names.len()).collect();
    as_text.sort_by_key(|&i| names[i]);
    if as_text.windows(2).any(|pair| pair[0] > pair[1]) {
        let mut by_text = vec![DMat4::IDENTITY; given.len()];
        let mut by_number = by_text.clone();
        for (place, &image) in as_text.iter().enumerate() {
            (by_text[image], by_number[place]) = (given[place], given[image]);
        }
        all.push(("in the order of image names as text".to_owned(), by_text));
        all.push(("in the order of the numbers in image names".to_owned(), by_number));
    }
    all
}

/// Returns the share of `matches` that cameras at `poses` explain, their focal lengths multiplied by `factor`.
fn share(matches: &[ImageMatches], cameras: &[Camera], chosen: &[usize], poses: &[DMat4], factor: f64) -> f64 {
    let explained = |pair: &ImageMatches| {
        let [a, b] = [pair.a, pair.b].map(|i| camera_pose(&poses[chosen[i]]));
        let longer = f64::from(cameras[pair.a].width.max(cameras[pair.a].height));
        let tolerance = TOLERANCE * longer / (factor * cameras[pair.a].fx);
        let is_explained = |&(in_a, in_b): &(DVec2, DVec2)| {
            let rays = ray(&cameras[pair.a], in_a, factor).zip(ray(&cameras[pair.b], in_b, factor));
            rays.is_some_and(|rays| explains([&a, &b], rays, tolerance))
        };
        pair.pixels.iter().filter(|pixels| is_explained(pixels)).count()
    };
    let all: usize = matches.iter().map(|pair| pair.pixels.len()).sum();
    matches.par_iter().map(explained).sum::<usize>() as f64 / all.max(1) as f64
}

/// Returns `(x, y) / z`, in the camera's axes of computer vision, of what is seen at a pixel.
pub(crate) fn ray(camera: &Camera, pixel: DVec2, factor: f64) -> Option<DVec2> {
    let focal = factor * DVec2::new(camera.fx, camera.fy);
    camera.lens.undistort((pixel - DVec2::new(camera.cx, camera.cy)) / focal)
}

/// Converts camera-to-world in OpenGL's axes to world-to-camera in those of computer vision.
pub(crate) fn camera_pose(to_world: &DMat4) -> Pose {
    let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)) * DMat3::from_mat4(*to_world).transpose();
    Pose { rotation, translation: -(rotation * to_world.w_axis.truncate()) }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use infonerf_scene::SceneRequest;
    use serde_json::json;

    use super::*;
    use crate::loaders::testing::write_json;

    /// Returns twelve photographs of a built-in scene, each with a pose and a focal length that `given` states.
    fn doubts(given: impl Fn(usize, &[Camera]) -> (DMat4, f64)) -> Vec<String> {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        fs::create_dir_all(dir.join("images")).unwrap();
        let cameras: Vec<Camera> = infonerf_procedural::photographs("table", 160, 40)[..12].to_vec();
        let frame = |i: usize| {
            let image = infonerf_procedural::render("table", &cameras[i]).unwrap().rgba;
            image.to_f32().composite([1.0; 3]).write_png(&dir.join(format!("images/p{i}.png"))).unwrap();
            let (pose, focal) = given(i, &cameras);
            let rows = pose.transpose().to_cols_array_2d();
            json!({"file_path": format!("images/p{i}.png"), "transform_matrix": rows, "fl_x": focal, "w": 160, "h": 160})
        };
        let frames: Vec<_> = (0..cameras.len()).map(frame).collect();
        write_json(&dir.join("transforms.json"), &json!({"frames": frames}));
        doubts_of(dir)
    }

    fn doubts_of(dir: &Path) -> Vec<String> {
        compare(&crate::loaders::read(dir, &SceneRequest::default()).unwrap().understood().unwrap()).unwrap()
    }

    #[test]
    fn the_convention_of_the_poses_is_named() {
        let right = |i: usize, all: &[Camera]| (all[i].to_world, all[i].fx);
        assert_eq!(doubts(right), [""; 0]);
        let flip = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        let order = [0, 1, 10, 11, 2, 3, 4, 5, 6, 7, 8, 9];
        let quarter = DMat4::from_rotation_z(90f64.to_radians());
        /// Pose and focal length that a capture gives for a camera.
        type Given<'a> = &'a dyn Fn(usize, &[Camera]) -> (DMat4, f64);
        let cases: [(Given<'_>, &str); 5] = [
            (&|i, all| (all[i].to_world * flip, all[i].fx), "with OpenCV's axes"),
            (&|i, all| (all[i].to_world.inverse(), all[i].fx), "as world-to-camera matrices they"),
            (&|i, all| (all[i].to_world * quarter, all[i].fx), "with cameras rolled by 270°"),
            (&|i, all| (all[order[i]].to_world, all[i].fx), "in the order of"),
            (&|i, all| (all[i].to_world, 24.0), "with focal lengths of about"),
        ];
        for (given, named) in cases {
            let found = doubts(given);
            let last = found.last().map_or("", String::as_str);
            assert!(last.contains("matches between 12 photographs") && last.contains(named), "{named}: {found:?}");
        }
        assert!(doubts(|i, all| (all[i].to_world, 24.0))[0].contains("is 0.15 image widths: is it in pixels"));
    }

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let mut names = ["p10", "p9", "a/p1", "p9b", "q1"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["a/p1", "p9", "p9b", "p10", "q1"]);
    }
}
