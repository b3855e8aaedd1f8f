//! `transforms*.json` files, as Blender exports and nerfstudio write them. Poses are read as they are; nerfstudio's
//! `applied_transform` is not undone.

use std::collections::HashSet;
use std::ops::Bound;
use std::path::{Path, PathBuf};

use glam::Vec3;
use infonerf_scene::image::{is_image_name, unread_format};
use infonerf_scene::{Aabb, Lens, SceneError};
use serde_json::Value;

use super::pose::read_pose;
use crate::capture::some_of;
use crate::colmap::lens;
use crate::files::json::{self, Node, pair};
use crate::files::{MAX_COORDINATE, PIXELS, file_name};
use crate::frame::{Frame, Intrinsics, Listed, MaskRole, find_by_end, keep_apart, without_extension};

/// Factor by which instant-ngp scales positions before it puts them into its unit cube, if the file has no `scale`.
const NGP_SCALE: f64 = 0.33;

pub(crate) struct Transforms {
    /// Frames with a pose, in the file's order.
    pub frames: Vec<Frame>,
    /// Names of the frames without a pose.
    pub lost: Vec<String>,
    pub warnings: Vec<String>,
    /// Optional fields `near` and `far`, scene units.
    pub range: Option<(f32, f32)>,
    /// Optional field `aabb`: `[[x, y, z], [x, y, z]]`.
    pub bounds: Option<Aabb>,
    /// The cube of instant-ngp's `aabb_scale`, in the file's coordinates.
    pub cube: Option<Aabb>,
    pub split: Option<Split>,
}

/// Names of frames in nerfstudio's fields; at least one list is there.
pub(crate) struct Split {
    /// Names in `train_filenames`.
    pub train: Option<Vec<String>>,
    /// Names in `test_field`.
    pub test: Option<Vec<String>>,
    /// `test_filenames`, or `val_filenames` if that alone names frames.
    pub test_field: &'static str,
}

/// Reads a `transforms*.json` file that has at least one frame with a pose; no image is opened.
pub(super) fn read_transforms(path: &Path) -> Result<Transforms, SceneError> {
    let read = transforms(path, &json::read(path)?)?;
    if read.frames.is_empty() {
        let found = format!("{} frames, none with a pose", read.lost.len());
        return Err(SceneError::field(path, "frames", "a list of at least one frame with `transform_matrix`", found));
    }
    Ok(read)
}

/// Converts the JSON of a `transforms*.json` file, which may have no frames.
pub(crate) fn transforms(path: &Path, value: &Value) -> Result<Transforms, SceneError> {
    let root = Node::root(path, value);
    let expected = "a list of frames";
    let items = root.get("frames", expected)?.items(expected)?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let (mut frames, mut stated, mut lost, mut scaled) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut listed = Listed::new();
    for (id, item) in items.iter().enumerate() {
        let name = item.get("file_path", "the path of an image")?.text("the path of an image")?;
        match read_pose(item, "transform_matrix")? {
            Some((pose, mended)) => {
                scaled.extend(mended.then(|| name.to_owned()));
                stated.push(stated_path(dir, name));
                frames.push(Frame { id, pose, ..read_frame((dir, &mut listed), &root, item, name)? });
            }
            None => lost.push(name_of(dir, &image_path(dir, name, &mut listed))),
        }
    }
    let alike = keep_apart(dir, &mut frames, &stated);
    let mut known = HashSet::new();
    let mut is_new = |frame: &Frame| known.insert((frame.image.clone(), frame.pose.to_cols_array().map(f64::to_bits)));
    let again: Vec<String> = frames.extract_if(.., |frame| !is_new(frame)).map(|frame| frame.name).collect();
    let of =
        |names: &[String], what: &str| some_of(names, items.len(), &format!("frames of {} {what}", file_name(path)));
    let left_out = of(&lost, "left out for want of a pose");
    let corrected = of(&scaled, "corrected to an exact rotation");
    let repeated = of(&again, "left out as a repetition");
    let mut warnings: Vec<String> = [left_out, corrected, repeated, alike].into_iter().flatten().collect();
    let (range, bounds) = (read_range(&root)?, root.optional("aabb", read_bounds)?);
    let cube = root.optional("aabb_scale", |node| read_aabb_scale(&root, node, &mut warnings))?;
    let split = read_split(dir, &root, &mut listed)?;
    Ok(Transforms { frames, lost, warnings, range, bounds, cube, split })
}

/// Reads instant-ngp's box: the cube of edge `aabb_scale` about (0.5, 0.5, 0.5), in which the position p of the file is
/// `scale · p + offset` (by default 0.33 and 0.5) with its axes exchanged, which leaves the cube as it is. An edge that is no
/// power of two becomes the next one, with a warning.
fn read_aabb_scale(root: &Node<'_>, node: Node<'_>, warnings: &mut Vec<String>) -> Result<Aabb, SceneError> {
    let stated = node.within(1.0..=128.0, "a power of two from 1 to 128")?;
    let edge = f64::from((stated.ceil() as u32).next_power_of_two());
    if edge != stated {
        warnings.push(format!("`aabb_scale` is {stated}, which is no power of two: {edge} is taken"));
    }
    let factor = |node: Node<'_>| node.within(1e-6..=1e6, "a factor from 1e-6 to 1e6");
    let scale = root.optional("scale", factor)?.unwrap_or(NGP_SCALE);
    let three = |node: Node<'_>| {
        let expected = "one or three numbers from -1e5 to 1e5";
        let offset = node.number(expected).map(|all| [all; 3]).or_else(|_| node.numbers(expected))?;
        if offset.iter().all(|o| o.abs() <= 1e5) { Ok(offset) } else { Err(node.error(expected)) }
    };
    let centre = root.optional("offset", three)?.unwrap_or([0.5; 3]).map(|offset| ((0.5 - offset) / scale) as f32);
    Ok(Aabb::cube(Vec3::from(centre), (0.5 * edge / scale) as f32))
}

fn read_frame(
    (dir, listed): (&Path, &mut Listed),
    root: &Node<'_>,
    frame: &Node<'_>,
    path: &str,
) -> Result<Frame, SceneError> {
    let depth = frame.optional("ray_depth_file_path", |node| Ok(dir.join(node.text("the path of an .npy file")?)))?;
    let (intrinsics, lens) = read_optics(root, frame)?;
    let image = image_path(dir, path, listed);
    // Other programs call it `mask`, or have something else under that name.
    let is_alias = frame.find("mask_path").is_none() && frame.find("mask").is_some_and(|node| node.text("").is_ok());
    let mask = frame.optional(if is_alias { "mask" } else { "mask_path" }, |node| {
        let named = node.text("the path of a mask image")?;
        let found = Some(image_path(dir, named, listed)).filter(|mask| *mask != image);
        Ok((found.unwrap_or_else(|| stated_path(dir, named)), MaskRole::Capture))
    })?;
    let name = name_of(dir, &image);
    Ok(Frame { id: 0, name, image, depth, mask, pose: glam::DMat4::IDENTITY, intrinsics, lens, points: Vec::new() })
}

fn read_range(root: &Node<'_>) -> Result<Option<(f32, f32)>, SceneError> {
    let Some((near, far)) = pair(|_| root, ["near", "far"], "a distance", Ok)? else { return Ok(None) };
    let n = near.within(0.0.., "a distance of at least 0")? as f32;
    let f = far.within(..=MAX_COORDINATE, "a distance beyond `near`")? as f32;
    if n >= f {
        return Err(far.error(format!("a distance beyond `near` = {n}")));
    }
    Ok(Some((n, f)))
}

fn read_bounds(node: Node<'_>) -> Result<Aabb, SceneError> {
    let expected = "two corners [[x, y, z], [x, y, z]], the least first";
    let [min, max] = &node.items(expected)?[..] else {
        return Err(node.error(expected));
    };
    let corner = |n: &Node<'_>| n.numbers::<3>(expected).map(|v| Vec3::from(v.map(|c| c as f32)));
    let (min, max) = (corner(min)?, corner(max)?);
    let inside = |corner: Vec3| f64::from(corner.abs().max_element()) <= MAX_COORDINATE;
    if !min.cmplt(max).all() || !inside(min) || !inside(max) {
        return Err(node.fault(expected, format!("{min} and {max}")));
    }
    Ok(Aabb { min, max })
}

fn read_split(dir: &Path, root: &Node<'_>, listed: &mut Listed) -> Result<Option<Split>, SceneError> {
    let expected = "a list of file paths";
    let is_empty = |node: Node<'_>| node.items(expected).is_ok_and(|all| all.is_empty());
    let is_validated = root.find("test_filenames").is_none_or(is_empty) && root.find("val_filenames").is_some();
    let test_field = if is_validated { "val_filenames" } else { "test_filenames" };
    let mut names = |node: Node<'_>| {
        let name = |n: &Node<'_>| n.text(expected).map(|s| name_of(dir, &image_path(dir, s, listed)));
        node.items(expected)?.iter().map(name).collect::<Result<Vec<_>, _>>()
    };
    let (train, test) = (root.optional("train_filenames", &mut names)?, root.optional(test_field, names)?);
    Ok((train.is_some() || test.is_some()).then_some(Split { train, test, test_field }))
}

/// Returns the path of an image below `dir`, without extension.
fn name_of(dir: &Path, image: &Path) -> String {
    without_extension(&image.strip_prefix(dir).unwrap_or(image).to_string_lossy())
}

/// Returns the path of the image that a file names, where `\` separates folders too; without such an image, [`stated_path`].
fn image_path(dir: &Path, named: &str, listed: &mut Listed) -> PathBuf {
    let relative = named.trim().replace('\\', "/");
    let found = find_by_end(dir, relative.trim_start_matches("./"), listed);
    found.map_or_else(|| stated_path(dir, named), |(path, _)| path)
}

/// Returns the path that a file states; without an image's extension `.png` is appended: `r_0.5` becomes `r_0.5.png`.
fn stated_path(dir: &Path, named: &str) -> PathBuf {
    let relative = named.trim().replace('\\', "/");
    let relative = relative.trim_start_matches("./");
    let whole = dir.join(relative);
    let complete = is_image_name(&whole) || unread_format(&whole).is_some();
    if complete { whole } else { dir.join(format!("{relative}.png")) }
}

/// Lens distortion coefficients of nerfstudio and instant-ngp.
const DISTORTION: [&str; 9] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "omega"];
const MAX_COEFFICIENT: f64 = 1e6;
/// Known values of `camera_model`. Within perspective models, coefficients decide which lens is used.
const MODELS: &str = "one of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, \
                      SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, FOV";

/// Reads the intrinsics and lens of a frame, each field from the frame if it has it, else from the file's root. A field
/// of view of the frame comes before a focal length of the root.
fn read_optics(root: &Node<'_>, frame: &Node<'_>) -> Result<(Intrinsics, Lens), SceneError> {
    let place = |key: &str| if frame.find(key).is_some() { frame } else { root };
    let lens = read_lens(place)?;
    let has_angle = frame.find("camera_angle_x").is_some() && frame.find("fl_x").is_none();
    let source = |key: &str| if has_angle { frame } else { place(key) };
    let focal = |key: &str| source(key).optional(key, |node| node.within(PIXELS, "a positive focal length in pixels"));
    let position = |node: Node<'_>| node.within(-*PIXELS.end()..=*PIXELS.end(), "a position in pixels");
    let side = |node: Node<'_>| {
        let expected = "an image side in whole pixels";
        let side = node.within(1.0..=f64::from(u32::MAX), expected)?;
        if side.fract() == 0.0 { Ok(side as u32) } else { Err(node.error(expected)) }
    };
    let centre = pair(place, ["cx", "cy"], "a position in pixels", position)?.map(|(x, y)| [x, y]);
    let size = pair(place, ["w", "h"], "an image side in pixels", side)?;
    if let Some(fx) = focal("fl_x")? {
        let focal = [fx, focal("fl_y")?.unwrap_or(fx)];
        return Ok((Intrinsics::Pixels { focal, centre, size }, lens));
    }
    if source("fl_y").find("fl_y").is_some() {
        source("fl_x").get("fl_x", "a focal length in pixels next to `fl_y`")?;
    }
    let expected = "a horizontal field of view between 0 and π radians";
    let range = (Bound::Excluded(0.0), Bound::Excluded(std::f64::consts::PI));
    let angle = root.find("camera_angle_x").filter(|_| !has_angle);
    let missing = format!("{expected} (or `fl_x`), there or for all frames");
    let x = angle.map_or_else(|| frame.get("camera_angle_x", &missing), Ok)?.within(range, expected)?;
    let vertical = |node: Node<'_>| node.within(range, "a vertical field of view between 0 and π radians");
    let y = source("camera_angle_y").optional("camera_angle_y", vertical)?;
    let Some((w, h)) = size else {
        if centre.is_some() {
            root.get("w", "an image side in pixels next to `camera_angle_x` and `cx`")?;
        }
        return Ok((Intrinsics::Fov(x, y), lens));
    };
    let in_pixels = |side: u32, angle: f64| 0.5 * f64::from(side) / (0.5 * angle).tan();
    let focal = [in_pixels(w, x), y.map_or(in_pixels(w, x), |y| in_pixels(h, y))];
    Ok((Intrinsics::Pixels { focal, centre, size }, lens))
}

/// Reads the lens from `camera_model` (or instant-ngp's `is_fisheye`) and coefficients; `place` finds a field's node.
fn read_lens<'n, 'a: 'n>(place: impl Fn(&str) -> &'n Node<'a>) -> Result<Lens, SceneError> {
    let mut values = [0.0; DISTORTION.len()];
    for (value, key) in values.iter_mut().zip(DISTORTION) {
        let read = |node: Node<'_>| node.within(-MAX_COEFFICIENT..=MAX_COEFFICIENT, "a distortion coefficient");
        *value = place(key).optional(key, read)?.unwrap_or(0.0);
    }
    let list = |node: Node<'_>| {
        let expected = "six distortion coefficients up to 1e6: k1, k2, k3, k4, p1 and p2";
        let all = node.numbers::<6>(expected)?;
        if all.iter().all(|k| k.abs() <= MAX_COEFFICIENT) { Ok(all) } else { Err(node.error(expected)) }
    };
    if let Some([k1, k2, k3, k4, p1, p2]) = place("distortion_params").optional("distortion_params", list)? {
        values = [k1, k2, k3, k4, 0.0, 0.0, p1, p2, 0.0];
    }
    let is_fisheye = place("is_fisheye").optional("is_fisheye", |node| node.flag("true or false"))?.unwrap_or(false);
    let value = |key: &str| DISTORTION.iter().zip(values).find(|(known, _)| **known == key).map_or(0.0, |(_, v)| v);
    let known = |node: Node<'_>| {
        let model = node.text(MODELS)?.to_ascii_uppercase();
        lens(&model, value).ok_or_else(|| node.error(MODELS))
    };
    let unnamed = if is_fisheye { "FISHEYE" } else { "PERSPECTIVE" };
    let named = place("camera_model").optional("camera_model", known)?;
    if is_fisheye && named.is_some_and(|lens| lens.is_perspective()) {
        return Err(place("is_fisheye").get("is_fisheye", "")?.error("false next to the perspective `camera_model`"));
    }
    Ok(named.or_else(|| lens(unnamed, value)).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use serde_json::json;

    use super::*;
    use crate::loaders::testing::pose;

    #[test]
    fn images_are_found_by_paths_of_other_computers() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        fs::create_dir_all(dir.join("scan/images")).unwrap();
        fs::write(dir.join("scan/images/0.png"), "").unwrap();
        for named in [
            "scan/images/0.png",
            ".\\scan\\images\\0",
            "C:\\Users\\me\\scan\\images\\0.png",
            "/home/other/scan/images/0.JPG",
            "scan/images/0.png ",
            "..\\data\\scan\\images\\0.png",
        ] {
            let found = image_path(dir, named, &mut Listed::new());
            assert_eq!((found.is_file(), name_of(dir, &found)), (true, "scan/images/0".into()), "{named}");
        }
        fs::write(dir.join("scan/images/0.webp"), "").unwrap();
        let mut listed = Listed::new();
        assert!(!image_path(dir, "Scan/images/0", &mut listed).is_file(), "two images are alike");
        fs::write(dir.join("scan/images/1.png"), "").unwrap();
        assert!(!image_path(dir, "Scan/images/1", &mut listed).is_file(), "the folder was listed before");
        assert!(image_path(dir, "Scan/images/1", &mut Listed::new()).is_file());
        let dotted = image_path(dir, "./train/r_0.5", &mut listed);
        assert_eq!((name_of(dir, &dotted), dotted), ("train/r_0.5".into(), dir.join("train/r_0.5.png")));
        assert_eq!(image_path(dir, "train/r_0.webp", &mut listed), dir.join("train/r_0.webp"));
    }

    #[test]
    fn no_image_takes_the_place_of_another() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        fs::create_dir(dir.join("D")).unwrap();
        // The name of the last image has a composed Ä, in the file a decomposed one.
        ["0.png", "1.jpg", "D/\u{c4} 2.png"].iter().for_each(|name| fs::write(dir.join(name), "").unwrap());
        let frame = |path: &str| json!({"file_path": path, "mask": "masks/1.png", "transform_matrix": pose(0)});
        let frames = ["a/0.png", "b/0.png", "c/1.png", "b/0.png", "s/d/a\u{308}%202.JPG"].map(frame);
        let value =
            json!({"camera_angle_x": 0.7, "aabb_scale": 3, "scale": 0.5, "offset": [0, 1, 0.5], "frames": frames});
        let read = transforms(&dir.join("transforms.json"), &value).unwrap();
        let images: Vec<&Path> = read.frames.iter().map(|frame| frame.image.as_path()).collect();
        assert_eq!(images, ["a/0.png", "b/0.png", "1.jpg", "D/\u{c4} 2.png"].map(|name| dir.join(name)));
        assert_eq!(read.frames[2].mask, Some((dir.join("masks/1.png"), MaskRole::Capture)));
        assert_eq!(read.cube, Some(Aabb::cube(Vec3::new(1.0, -1.0, 0.0), 4.0)), "instant-ngp's box");
        let repeated = "1 of 5 frames of transforms.json left out as a repetition: 0";
        let alike = "images whose stated names differ in case, accents or escapes: 1 of 5, such as \u{c4} 2.png for \
                     a\u{308}%202.JPG";
        assert_eq!(read.warnings, [repeated, alike, "`aabb_scale` is 3, which is no power of two: 4 is taken"]);
    }
}
