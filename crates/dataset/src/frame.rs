//! Frame: an image that can be loaded, with its camera.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DMat4;
use infonerf_scene::image::{dimensions, find_image, is_image_name};
use infonerf_scene::{Camera, Lens, SceneError};
use percent_encoding::percent_decode_str;
use unicode_normalization::UnicodeNormalization;

use crate::files::{entries, file_name};

#[derive(Clone, Debug)]
pub(crate) struct Frame {
    pub id: usize,
    /// Path within the scene without extension.
    pub name: String,
    pub image: PathBuf,
    /// Exact distances along the pixel rays, `[height, width]` in an `.npy` file.
    pub depth: Option<PathBuf>,
    pub mask: Option<(PathBuf, MaskRole)>,
    /// Camera-to-world, OpenGL.
    pub pose: DMat4,
    pub intrinsics: Intrinsics,
    pub lens: Lens,
    /// Indices of the capture's points that a reconstruction saw in the image.
    pub points: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskRole {
    /// Masked metrics use only the pixels that are not black.
    Counts,
    /// Masked metrics use only the pixels that are not black, and the mask is the image's alpha.
    Matte,
    /// Only pixels that are not black belong to the capture, see [`infonerf_scene::MaskUse`].
    Capture,
    /// instant-ngp's `dynamic_mask_*`, the inverse of [`Self::Capture`]: white pixels are left out.
    Dynamic,
}

impl Frame {
    pub fn new(name: &str, image: PathBuf, camera: &Camera) -> Self {
        let (name, intrinsics) = (without_extension(name), Intrinsics::of(camera));
        let Camera { to_world: pose, lens, .. } = *camera;
        Self { id: 0, name, image, depth: None, mask: None, pose, intrinsics, lens, points: Vec::new() }
    }

    /// Returns the camera for an image of `width × height` pixels. Intrinsics for another size are scaled.
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        let stated = self.stated_size().unwrap_or((width, height));
        let camera = match self.intrinsics {
            Intrinsics::Fov(x, y) => {
                let camera = Camera::from_fov(stated.0, stated.1, x, self.pose);
                Camera { fy: y.map_or(camera.fy, |y| Camera::from_fov(stated.1, 1, y, self.pose).fx), ..camera }
            }
            Intrinsics::Pixels { focal, centre, .. } => {
                let centre = centre.unwrap_or([stated.0, stated.1].map(|side| f64::from(side) / 2.0));
                Camera::pinhole(stated, focal, centre, self.pose)
            }
        };
        camera.with_lens(self.lens).resized(width, height)
    }

    /// Returns the camera for the stated image size, or else for twice the principal point, the focal lengths, or 1×1 pixels.
    pub fn nominal_camera(&self) -> Camera {
        let side = |side: f64| side.round().clamp(1.0, 1e6) as u32;
        let (width, height) = match self.intrinsics {
            Intrinsics::Pixels { size: Some(size), .. } => size,
            Intrinsics::Pixels { centre: Some([x, y]), .. } => (side(2.0 * x), side(2.0 * y)),
            Intrinsics::Pixels { focal: [x, y], .. } => (side(x), side(y)),
            Intrinsics::Fov(..) => (1, 1),
        };
        self.camera(width, height)
    }

    pub fn stated_size(&self) -> Option<(u32, u32)> {
        if let Intrinsics::Pixels { size, .. } = self.intrinsics { size } else { None }
    }
}

/// Intrinsics before the image size is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Intrinsics {
    /// Horizontal and vertical field of view in radians, without the latter for square pixels; centred principal point.
    Fov(f64, Option<f64>),
    /// Focal lengths and principal point in pixels, and the image size that they hold for if it is stated.
    Pixels { focal: [f64; 2], centre: Option<[f64; 2]>, size: Option<(u32, u32)> },
}

impl Intrinsics {
    pub fn of(camera: &Camera) -> Self {
        let &Camera { width, height, fx, fy, cx, cy, .. } = camera;
        Self::Pixels { focal: [fx, fy], centre: Some([cx, cy]), size: Some((width, height)) }
    }
}

/// Returns the cameras of `frames`. Frames without a stated size take the size of the first image file that exists.
pub(crate) fn cameras_of(frames: &[Frame]) -> Result<Vec<Camera>, SceneError> {
    let size = frames.iter().find(|frame| frame.image.is_file()).map(|frame| dimensions(&frame.image)).transpose()?;
    let camera = |frame: &Frame| match (frame.stated_size(), size) {
        (None, Some((width, height))) => frame.camera(width, height),
        _ => frame.nominal_camera(),
    };
    Ok(frames.iter().map(camera).collect())
}

/// Removes frames without an image file, and returns a warning. If all lack one, all are kept: loading reports the first.
pub(crate) fn with_images(frames: Vec<Frame>) -> (Vec<Frame>, Option<String>) {
    let total = frames.len();
    let (there, missing): (Vec<_>, Vec<_>) = frames.into_iter().partition(|f| f.image.is_file());
    let warning = missing.first().map(|first| {
        format!("{} of {total} frames without an image, such as {}", missing.len(), first.image.display())
    });
    (if there.is_empty() { missing } else { there }, warning)
}

pub(crate) fn numbered(frames: Vec<Frame>) -> Vec<Frame> {
    frames.into_iter().enumerate().map(|(id, frame)| Frame { id, ..frame }).collect()
}

/// Finds the image in `folder` that a file calls `name`, whatever its extension. Of a path of another computer the longest end
/// that exists here is used, also as by [`find_alike`]. Returns its path and its name within the folder.
pub(crate) fn find_by_end<'n>(folder: &Path, name: &'n str, listed: &mut Listed) -> Option<(PathBuf, &'n str)> {
    let starts = std::iter::once(0).chain(name.match_indices('/').map(|(at, _)| at + 1));
    let mut ends = starts.map(|at| &name[at..]);
    let exact = ends.clone().find_map(|end| Some((find_image(&folder.join(end))?, end)));
    exact.or_else(|| ends.find_map(|end| Some((find_alike(folder, end, listed)?, end))))
}

/// Folders that were listed: the paths in each, with their [`comparable`] names.
pub(crate) type Listed = HashMap<PathBuf, Vec<(String, PathBuf)>>;

/// Returns the name of an image or folder without extension, in small letters, composed characters and no `%` escapes.
fn comparable(name: &str) -> String {
    let name = without_extension(name);
    percent_decode_str(&name).decode_utf8_lossy().nfc().flat_map(char::to_lowercase).collect()
}

/// Finds the image whose path below `folder` differs from `name` by upper and lower case, Unicode normalisation, `%`
/// escapes or the extension; `None` if there are several.
fn find_alike(folder: &Path, name: &str, listed: &mut Listed) -> Option<PathBuf> {
    let named = |path: PathBuf| (comparable(&file_name(&path)), path);
    let mut alike = vec![folder.to_owned()];
    for part in name.split('/').filter(|part| !part.is_empty()).map(comparable) {
        let mut found = Vec::new();
        for folder in alike {
            let inside =
                listed.entry(folder).or_insert_with_key(|folder| entries(folder).into_iter().map(named).collect());
            found.extend(inside.iter().filter(|(name, _)| *name == part).map(|(_, path)| path.clone()));
        }
        alike = found;
    }
    alike.retain(|path| is_image_name(path) && path.is_file());
    alike.pop().filter(|_| alike.is_empty())
}

/// Gives frames for which one image in `folder` was found under different names the paths that their file states: the image
/// is at most one frame's, and the others are missing. Returns a warning of images that [`find_alike`] found.
pub(crate) fn keep_apart(folder: &Path, frames: &mut [Frame], stated: &[PathBuf]) -> Option<String> {
    let mut names: HashMap<PathBuf, HashSet<&PathBuf>> = HashMap::new();
    for (frame, path) in frames.iter().zip(stated) {
        names.entry(frame.image.clone()).or_default().insert(path);
    }
    for (frame, path) in frames.iter_mut().zip(stated).filter(|(frame, _)| names[&frame.image].len() > 1) {
        frame.image.clone_from(path);
    }
    let bare = |path: &Path| PathBuf::from(without_extension(&path.to_string_lossy()));
    let is_alike = |(frame, path): &(&Frame, &PathBuf)| {
        frame.image.strip_prefix(folder).is_ok_and(|found| !bare(path).ends_with(bare(found)))
    };
    let alike: Vec<(&Frame, &PathBuf)> = frames.iter().zip(stated).filter(is_alike).collect();
    let [found, named] = alike.first().map(|(frame, path)| [&frame.image, path].map(|path| file_name(path)))?;
    let (count, all) = (alike.len(), frames.len());
    let text = "images whose stated names differ in case, accents or escapes";
    Some(format!("{text}: {count} of {all}, such as {found} for {named}"))
}

/// Removes the extension of an image from a path.
pub(crate) fn without_extension(relative: &str) -> String {
    let path = Path::new(relative);
    let bare = if is_image_name(path) { path.with_extension("") } else { path.to_owned() };
    bare.to_string_lossy().into_owned()
}
