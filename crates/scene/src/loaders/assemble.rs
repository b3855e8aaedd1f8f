//! From lists of frames to a scene: selection, decoding, resizing, compositing.

use std::path::Path;

use rayon::prelude::*;

use super::depth::read_depth;
use super::frames::Frame;
use crate::image::{dimensions, read_rgba, resized_dimensions};
use crate::{Aabb, Camera, Scene, SceneError, SceneRequest, View};

/// All that a loader has found out, with no image read.
pub(super) struct Parts<'a> {
    /// The scene's folder, for its name.
    pub dir: &'a Path,
    /// Every training frame.
    pub train: Vec<Frame>,
    /// Every test frame.
    pub test: Vec<Frame>,
    /// Near and far distance, scene units.
    pub range: (f32, f32),
    /// What is to be reconstructed.
    pub bounds: Aabb,
}

/// Chooses views, reads their images in parallel and puts the scene together.
///
/// All chosen images must have the size of the first; a size that the poses state must be theirs.
pub(super) fn assemble(parts: Parts<'_>, request: &SceneRequest) -> Result<Scene, SceneError> {
    // Selection looks at poses alone, so that any size will do before one is known.
    let poses: Vec<Camera> = parts.train.iter().map(|f| f.camera(1, 1)).collect();
    let train_ids = request.train.select(&poses)?;
    let test_ids = request.test.select(parts.test.len())?;

    let first = train_ids.first().and_then(|&i| parts.train.get(i));
    let native = match first {
        Some(frame) => dimensions(&frame.image)?,
        None => return Err(SceneError::request("train", "at least one view", "none")),
    };
    let size = match request.image_size {
        Some(longest) => resized_dimensions(native.0, native.1, longest),
        None => native,
    };
    let read = |ids: &[usize], frames: &[Frame]| -> Result<Vec<View>, SceneError> {
        let views: Vec<_> = ids
            .par_iter()
            .filter_map(|&id| frames.get(id).map(|frame| (id, frame)))
            .map(|(id, frame)| read_view(id, frame, native, size, request.background))
            .collect();
        // The first fault in the order of the views, whichever thread met it first.
        views.into_iter().collect()
    };
    Ok(Scene {
        name: scene_name(parts.dir),
        train: read(&train_ids, &parts.train)?,
        test: read(&test_ids, &parts.test)?,
        background: request.background,
        near: parts.range.0,
        far: parts.range.1,
        bounds: parts.bounds,
        all_train_cameras: parts.train.iter().map(|f| f.camera(native.0, native.1).resized(size.0, size.1)).collect(),
    })
}

fn read_view(
    id: usize,
    frame: &Frame,
    native: (u32, u32),
    size: (u32, u32),
    background: [f32; 3],
) -> Result<View, SceneError> {
    let found = dimensions(&frame.image)?;
    for wanted in [Some(native), frame.stated_size()].into_iter().flatten() {
        if found != wanted {
            let expected = format!("an image of {}×{} pixels like the others", wanted.0, wanted.1);
            let reason = format!("it has {}×{}", found.0, found.1);
            return Err(SceneError::malformed(&frame.image, expected, reason));
        }
    }
    let depth = match &frame.depth {
        Some(path) if size == native => Some(read_depth(path, native.0, native.1)?),
        _ => None,
    };
    let rgba = read_rgba(&frame.image)?;
    Ok(View {
        id,
        name: frame.name.clone(),
        camera: frame.camera(native.0, native.1).resized(size.0, size.1),
        image: rgba.composite_resized(size.0, size.1, background),
        depth,
    })
}

/// The folder's name, also for paths such as `.` that do not end in one.
fn scene_name(dir: &Path) -> String {
    let whole = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    whole.file_name().map_or_else(|| "scene".into(), |n| n.to_string_lossy().into_owned())
}
