//! The `frames` of a `transforms*.json` file, as Blender exports and nerfstudio write them.

use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};
use infonerf_scene::image::{dimensions, is_heic};
use infonerf_scene::{Aabb, Camera, Lens, SceneError};

use super::json::{JsonFile, Node};
use super::mask::MaskRole;
use super::optics::{Intrinsics, read_optics};
use super::pose::read_pose;
use crate::limits::FARTHEST;

/// Extensions tried, in this order, for a `file_path` without one.
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];
/// What instant-ngp multiplies positions by before it puts them into its unit cube.
const NGP_SCALE: f64 = 0.33;

/// One image that can be loaded.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// The number that selections know it by.
    pub id: usize,
    /// Path within the scene without extension.
    pub name: String,
    /// The image file.
    pub image: PathBuf,
    /// Exact distances along the pixel rays, `[height, width]` in an `.npy` file.
    pub depth: Option<PathBuf>,
    /// An image that says which pixels count, and what for.
    pub mask: Option<(PathBuf, MaskRole)>,
    /// Camera-to-world, OpenGL.
    pub pose: DMat4,
    /// Focal lengths and principal point, as the file gives them.
    pub intrinsics: Intrinsics,
    /// How the lens bends rays.
    pub lens: Lens,
}

impl Frame {
    /// The camera for an image of `width × height` pixels as stored on disk. Intrinsics for another size are scaled.
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        let stated = self.stated_size().unwrap_or((width, height));
        self.intrinsics.camera(stated, self.pose).with_lens(self.lens).resized(width, height)
    }

    /// The camera for an image of the stated size, or of one that the intrinsics suggest.
    pub fn nominal_camera(&self) -> Camera {
        let (width, height) = self.intrinsics.nominal_size();
        self.camera(width, height)
    }

    /// Whether the mask beside the image is its alpha channel.
    pub fn is_matted(&self) -> bool {
        matches!(self.mask, Some((_, MaskRole::Matte)))
    }

    /// The image size that the poses file states.
    pub fn stated_size(&self) -> Option<(u32, u32)> {
        self.intrinsics.stated_size()
    }
}

/// The cameras of `frames`: one image tells the size of all that do not state theirs, where there is any.
pub(super) fn cameras_of(frames: &[Frame]) -> Result<Vec<Camera>, SceneError> {
    let size = frames.iter().find(|frame| frame.image.is_file()).map(|frame| dimensions(&frame.image)).transpose()?;
    let camera = |frame: &Frame| match (frame.stated_size(), size) {
        (None, Some((width, height))) => frame.camera(width, height),
        _ => frame.nominal_camera(),
    };
    Ok(frames.iter().map(camera).collect())
}

/// The frames whose image is there, and a warning about those whose is not. Where none is, all: the error will name one.
pub(super) fn present(frames: Vec<Frame>) -> (Vec<Frame>, Option<String>) {
    let total = frames.len();
    let (there, missing): (Vec<_>, Vec<_>) = frames.into_iter().partition(|f| f.image.is_file());
    let warning = missing
        .first()
        .map(|first| format!("{} of {total} frames have no image, the first {}", missing.len(), first.image.display()));
    (if there.is_empty() { missing } else { there }, warning)
}

/// The frames with their places in the list as ids.
pub(super) fn numbered(frames: Vec<Frame>) -> Vec<Frame> {
    frames.into_iter().enumerate().map(|(id, frame)| Frame { id, ..frame }).collect()
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
    /// The cube of instant-ngp's `aabb_scale`, in the file's coordinates.
    pub cube: Option<Aabb>,
    /// Names under the fields `train_filenames` and `test_filenames` of nerfstudio (without these, `val_filenames`).
    pub split: Option<Split>,
}

/// Names of frames, without extension.
#[derive(Debug)]
pub(crate) struct Split {
    pub train: Vec<String>,
    pub test: Vec<String>,
    /// The field that `test` is from.
    pub test_field: &'static str,
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
    let frames = items.iter().enumerate().map(|(i, f)| read_frame(dir, &root, i, f)).collect::<Result<Vec<_>, _>>()?;
    if let Some(i) = frames.iter().position(|f| f.mask.is_some() != frames[0].mask.is_some()) {
        let at = if frames[i].mask.is_some() { 0 } else { i };
        let expected = "the path of a mask, as other frames have one";
        items[at].get("mask_path", expected)?;
    }
    check_applied(&root)?;
    Ok(Transforms {
        frames,
        range: read_range(&root)?,
        bounds: read_bounds(&root)?,
        cube: read_aabb_scale(&root)?,
        split: read_split(&root)?,
    })
}

/// `applied_transform` took the capture's own coordinates to the file's, which are the ones used here: it is only looked
/// at for being what it should.
fn check_applied(root: &Node<'_>) -> Result<(), SceneError> {
    let Some(node) = root.find("applied_transform") else { return Ok(()) };
    let expected = "a 3×4 matrix";
    let rows = node.items(expected)?;
    if !(3..=4).contains(&rows.len()) {
        return Err(node.fault(expected, format!("{} rows", rows.len())));
    }
    rows.iter().try_for_each(|row| row.numbers::<4>("4 finite numbers, a row of a 3×4 matrix").map(drop))
}

/// instant-ngp's box: a cube of `aabb_scale` times its unit cube, which is `1 / 0.33` wide about the origin.
fn read_aabb_scale(root: &Node<'_>) -> Result<Option<Aabb>, SceneError> {
    let Some(node) = root.find("aabb_scale") else { return Ok(None) };
    let expected = "a power of two from 1 to 128";
    let scale = node.number(expected)?;
    if !(1.0..=128.0).contains(&scale) || scale.log2().fract() != 0.0 {
        return Err(node.error(expected));
    }
    Ok(Some(Aabb::cube(Vec3::ZERO, (0.5 * scale / NGP_SCALE) as f32)))
}

fn read_frame(dir: &Path, root: &Node<'_>, id: usize, frame: &Node<'_>) -> Result<Frame, SceneError> {
    let expected = "the path of an image";
    let path = frame.get("file_path", expected)?.text(expected)?;
    let relative = path.trim_start_matches("./");
    let depth = match frame.find("ray_depth_file_path") {
        Some(node) => Some(dir.join(node.text("the path of an .npy file")?)),
        None => None,
    };
    let mask = match frame.find("mask_path") {
        Some(node) => {
            let relative = node.text("the path of a mask image")?;
            Some((image_path(dir, relative.trim_start_matches("./")), MaskRole::Capture))
        }
        None => None,
    };
    let (intrinsics, lens) = read_optics(root, frame)?;
    Ok(Frame {
        id,
        name: without_extension(relative),
        image: image_path(dir, relative),
        depth,
        mask,
        pose: read_pose(&frame.get("transform_matrix", "a 4×4 matrix")?)?,
        intrinsics,
        lens,
    })
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
    let test = ["test_filenames", "val_filenames"].into_iter().find_map(|field| Some((field, root.find(field)?)));
    let (Some(train), Some((test_field, test))) = (root.find("train_filenames"), test) else {
        return Ok(None);
    };
    let names = |node: Node<'_>| {
        let expected = "a list of file paths";
        let name = |n: &Node<'_>| n.text(expected).map(|s| without_extension(s.trim_start_matches("./")));
        node.items(expected)?.iter().map(name).collect::<Result<Vec<_>, _>>()
    };
    Ok(Some(Split { train: names(train)?, test: names(test)?, test_field }))
}

pub(super) fn known_extension(path: &Path) -> bool {
    path.extension().and_then(|e| e.to_str()).is_some_and(|e| EXTENSIONS.contains(&e.to_ascii_lowercase().as_str()))
}

pub(super) fn without_extension(relative: &str) -> String {
    let path = Path::new(relative);
    let bare = if known_extension(path) { path.with_extension("") } else { path.to_owned() };
    bare.to_string_lossy().into_owned()
}

/// `file_path` as it stands if it names an image, else the first of [`EXTENSIONS`] that exists (or
/// `.png`, for the error). Extensions are appended: a name such as `r_0.5` keeps its dot.
fn image_path(dir: &Path, relative: &str) -> PathBuf {
    let whole = dir.join(relative);
    if known_extension(&whole) || is_heic(&whole) {
        return whole;
    }
    let with = |extension: &str| dir.join(format!("{relative}.{extension}"));
    EXTENSIONS.iter().map(|e| with(e)).find(|p| p.is_file()).unwrap_or_else(|| with("png"))
}
