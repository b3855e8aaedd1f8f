//! Frame: an image that can be loaded, with its camera.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DMat4;
use infonerf_scene::image::{dimensions, find_image, is_image_name};
use infonerf_scene::{Camera, Lens, SceneError};

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
    /// Masked metrics use only the pixels that are not black, and the others show nothing: the mask is the image's
    /// alpha.
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
    let warning = missing
        .first()
        .map(|first| format!("{} of {total} frames have no image, the first {}", missing.len(), first.image.display()));
    (if there.is_empty() { missing } else { there }, warning)
}

pub(crate) fn numbered(frames: Vec<Frame>) -> Vec<Frame> {
    frames.into_iter().enumerate().map(|(id, frame)| Frame { id, ..frame }).collect()
}

/// Finds the image in `folder` that a file calls `name`. Its extension may differ or be missing. Of a path of another
/// computer the longest end that exists here is used. Returns its path and its name within the folder.
pub(crate) fn find_by_end<'n>(folder: &Path, name: &'n str) -> Option<(PathBuf, &'n str)> {
    let starts = std::iter::once(0).chain(name.match_indices('/').map(|(at, _)| at + 1));
    starts.map(|at| &name[at..]).find_map(|end| Some((find_image(&folder.join(end))?, end)))
}

/// Gives frames for which one image was found under different names the paths that their file states: the image is at
/// most one frame's, and the others are missing.
pub(crate) fn keep_apart(frames: &mut [Frame], stated: &[PathBuf]) {
    let mut names: HashMap<PathBuf, HashSet<&PathBuf>> = HashMap::new();
    for (frame, path) in frames.iter().zip(stated) {
        names.entry(frame.image.clone()).or_default().insert(path);
    }
    for (frame, path) in frames.iter_mut().zip(stated).filter(|(frame, _)| names[&frame.image].len() > 1) {
        frame.image.clone_from(path);
    }
}

/// Removes the extension of an image from a path.
pub(crate) fn without_extension(relative: &str) -> String {
    let path = Path::new(relative);
    let bare = if is_image_name(path) { path.with_extension("") } else { path.to_owned() };
    bare.to_string_lossy().into_owned()
}
