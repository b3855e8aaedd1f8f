//! The `frames` of a `transforms*.json` file, as Blender exports and nerfstudio write them.

use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};

use super::json::{JsonFile, Node, PIXELS};
use super::pose::{FARTHEST, read_pose};
use crate::{Aabb, Camera, SceneError};

/// Extensions tried, in this order, for a `file_path` without one.
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];
/// Lens distortion coefficients of nerfstudio and instant-ngp, none of which is supported.
const DISTORTION: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];

/// One image that can be loaded.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// Path within the scene without extension.
    pub name: String,
    /// The image file.
    pub image: PathBuf,
    /// Exact distances along the pixel rays, `[height, width]` in an `.npy` file.
    pub depth: Option<PathBuf>,
    /// Camera-to-world, OpenGL.
    pub pose: DMat4,
    /// What the file says of the lens.
    pub lens: Lens,
}

/// Intrinsics before the image size is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Lens {
    /// Horizontal field of view in radians; square pixels, centred principal point.
    Fov(f64),
    /// Focal lengths and principal point in pixels, and the image size that they hold for where it
    /// is stated.
    Pinhole { focal: [f64; 2], centre: Option<[f64; 2]>, size: Option<(u32, u32)> },
}

impl Frame {
    /// The camera for an image of `width × height` pixels as stored on disk.
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        match self.lens {
            Lens::Fov(angle) => Camera::from_fov(width, height, angle, self.pose),
            Lens::Pinhole { focal: [fx, fy], centre, .. } => {
                let [cx, cy] = centre.unwrap_or([f64::from(width) / 2.0, f64::from(height) / 2.0]);
                Camera { width, height, fx, fy, cx, cy, to_world: self.pose }
            }
        }
    }

    /// The image size that the poses file states.
    pub fn stated_size(&self) -> Option<(u32, u32)> {
        match self.lens {
            Lens::Pinhole { size, .. } => size,
            Lens::Fov(_) => None,
        }
    }
}

/// What one `transforms*.json` file says.
#[derive(Debug)]
pub(crate) struct Transforms {
    /// Its images, in the file's order.
    pub frames: Vec<Frame>,
    /// Optional fields `near` and `far`, scene units.
    pub range: Option<(f32, f32)>,
    /// Optional field `aabb`: `[[x, y, z], [x, y, z]]`.
    pub bounds: Option<Aabb>,
    /// Names under the fields `train_filenames` and `test_filenames` of nerfstudio.
    pub split: Option<Split>,
}

/// Names of frames, without extension.
#[derive(Debug)]
pub(crate) struct Split {
    pub train: Vec<String>,
    pub test: Vec<String>,
}

/// Reads a `transforms*.json` file; no image is opened.
pub(super) fn read_transforms(path: &Path) -> Result<Transforms, SceneError> {
    transforms(path, &JsonFile::read(path)?)
}

/// What the parsed file at `path` says.
pub(crate) fn transforms(path: &Path, file: &JsonFile) -> Result<Transforms, SceneError> {
    let root = file.root();
    let expected = "a list of at least one frame";
    let list = root.get("frames", expected)?;
    let items = list.items(expected)?;
    if items.is_empty() {
        return Err(list.error(expected));
    }
    let dir = path.parent().unwrap_or(Path::new(""));
    let frames = items.iter().map(|f| read_frame(dir, &root, f)).collect::<Result<_, _>>()?;
    Ok(Transforms { frames, range: read_range(&root)?, bounds: read_bounds(&root)?, split: read_split(&root)? })
}

fn read_frame(dir: &Path, root: &Node<'_>, frame: &Node<'_>) -> Result<Frame, SceneError> {
    let expected = "the path of an image";
    let path = frame.get("file_path", expected)?.text(expected)?;
    let relative = path.trim_start_matches("./");
    let depth = match frame.find("ray_depth_file_path") {
        Some(node) => Some(dir.join(node.text("the path of an .npy file")?)),
        None => None,
    };
    Ok(Frame {
        name: without_extension(relative),
        image: image_path(dir, relative),
        depth,
        pose: read_pose(&frame.get("transform_matrix", "a 4×4 matrix")?)?,
        lens: read_lens(root, frame)?,
    })
}

/// A frame's own intrinsics or, field by field, those of the file.
fn read_lens(root: &Node<'_>, frame: &Node<'_>) -> Result<Lens, SceneError> {
    let find = |key: &str| frame.find(key).or_else(|| root.find(key));
    for key in DISTORTION {
        if let Some(node) = find(key)
            && node.number("a distortion coefficient")? != 0.0
        {
            return Err(node.error("0 (undistorted images; lens distortion is not supported)"));
        }
    }
    let Some(focal_x) = find("fl_x") else {
        let expected = "a horizontal field of view between 0 and π radians";
        let node = match find("camera_angle_x") {
            Some(node) => node,
            None => root.get("camera_angle_x", &format!("{expected} (or `fl_x`)"))?,
        };
        let angle = node.number(expected)?;
        if angle <= 0.0 || angle >= std::f64::consts::PI {
            return Err(node.error(expected));
        }
        return Ok(Lens::Fov(angle));
    };
    let expected = "a positive focal length in pixels";
    let fx = focal_x.pixels(expected)?;
    let fy = find("fl_y").map_or(Ok(fx), |node| node.pixels(expected))?;
    let position = |node: Node<'_>| {
        let expected = "a position in pixels";
        let position = node.number(expected)?;
        if position.abs() <= *PIXELS.end() { Ok(position) } else { Err(node.error(expected)) }
    };
    let number = |key| find(key).map(position).transpose();
    let centre = number("cx")?.zip(number("cy")?).map(|(x, y)| [x, y]);
    let side = |key| find(key).map(|node| read_side(&node)).transpose();
    let size = side("w")?.zip(side("h")?);
    Ok(Lens::Pinhole { focal: [fx, fy], centre, size })
}

fn read_side(node: &Node<'_>) -> Result<u32, SceneError> {
    let expected = "an image side in whole pixels";
    let side = node.positive(expected)?;
    if side.fract() != 0.0 || side > f64::from(u32::MAX) {
        return Err(node.error(expected));
    }
    Ok(side as u32)
}

fn read_range(root: &Node<'_>) -> Result<Option<(f32, f32)>, SceneError> {
    let (Some(near), Some(far)) = (root.find("near"), root.find("far")) else {
        return Ok(None);
    };
    let n = near.number("a distance of at least 0")? as f32;
    let f = far.number("a distance beyond `near`")? as f32;
    if n < 0.0 {
        return Err(near.error("a distance of at least 0"));
    }
    if n >= f || f64::from(f) > FARTHEST {
        return Err(far.error(format!("a distance beyond `near` = {n}")));
    }
    Ok(Some((n, f)))
}

fn read_bounds(root: &Node<'_>) -> Result<Option<Aabb>, SceneError> {
    let Some(node) = root.find("aabb") else {
        return Ok(None);
    };
    let expected = "two corners [[x, y, z], [x, y, z]], the least first";
    let [min, max] = &node.items(expected)?[..] else {
        return Err(node.error(expected));
    };
    let corner = |n: &Node<'_>| n.numbers::<3>(expected).map(|v| Vec3::from(v.map(|c| c as f32)));
    let (min, max) = (corner(min)?, corner(max)?);
    let inside = |corner: Vec3| f64::from(corner.abs().max_element()) <= FARTHEST;
    if !min.cmplt(max).all() || !inside(min) || !inside(max) {
        return Err(node.fault(expected, format!("{min} and {max}")));
    }
    Ok(Some(Aabb { min, max }))
}

fn read_split(root: &Node<'_>) -> Result<Option<Split>, SceneError> {
    let (Some(train), Some(test)) = (root.find("train_filenames"), root.find("test_filenames")) else {
        return Ok(None);
    };
    let names = |node: Node<'_>| {
        let expected = "a list of file paths";
        let name = |n: &Node<'_>| n.text(expected).map(|s| without_extension(s.trim_start_matches("./")));
        node.items(expected)?.iter().map(name).collect::<Result<Vec<_>, _>>()
    };
    Ok(Some(Split { train: names(train)?, test: names(test)? }))
}

pub(super) fn known_extension(path: &Path) -> bool {
    path.extension().and_then(|e| e.to_str()).is_some_and(|e| EXTENSIONS.contains(&e.to_ascii_lowercase().as_str()))
}

fn without_extension(relative: &str) -> String {
    let path = Path::new(relative);
    let bare = if known_extension(path) { path.with_extension("") } else { path.to_owned() };
    bare.to_string_lossy().into_owned()
}

/// `file_path` as it stands if it names an image, else the first of [`EXTENSIONS`] that exists (or
/// `.png`, for the error). Extensions are appended: a name such as `r_0.5` keeps its dot.
fn image_path(dir: &Path, relative: &str) -> PathBuf {
    let whole = dir.join(relative);
    if known_extension(&whole) {
        return whole;
    }
    let with = |extension: &str| dir.join(format!("{relative}.{extension}"));
    EXTENSIONS.iter().map(|e| with(e)).find(|p| p.is_file()).unwrap_or_else(|| with("png"))
}
