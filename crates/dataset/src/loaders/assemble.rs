//! From lists of frames to a scene: selection, decoding, resizing, compositing.

use std::path::Path;
use std::sync::Arc;

use infonerf_scene::image::{dimensions, has_alpha, read_rgba, resized_dimensions, resized_mask};
use infonerf_scene::select::pool::{self, Named};
use infonerf_scene::{
    Backdrop, Camera, Format, Layout, PixelCount, Scene, SceneError, SceneRequest, Space, TestProtocol, View,
};
use rayon::prelude::*;

use super::depth::read_depth;
use super::frames::Frame;
use super::mask::{MaskRole, lens_mask, read_mask};

/// The most that the chosen images may take in memory together, in bytes: 3.75 GiB.
const MOST_BYTES: u64 = 15 << 28;
/// The most that is decoded at once before it is resized, in pixels of the files.
const MOST_AT_ONCE: u64 = 24 << 20;

/// All that a loader has found out, with no image read.
pub(crate) struct Parts<'a> {
    /// The scene's folder, for its name.
    pub dir: &'a Path,
    /// Its format.
    pub format: Format,
    /// Every training frame.
    pub train: Vec<Frame>,
    /// Every test frame.
    pub test: Vec<Frame>,
    /// The ids of the test frames that are the format's own test split, where not all are.
    pub split: Option<Vec<usize>>,
    /// Published selections of training frames.
    pub selections: Named,
    /// Published sets of test frames.
    pub protocols: Named,
    /// Where the content is.
    pub space: Space,
    /// The colour that mattes are composited on, where the format says so.
    pub background: Option<[f32; 3]>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

impl<'a> Parts<'a> {
    /// Parts with the test frames as their own split, without names and warnings.
    pub fn new(dir: &'a Path, format: Format, train: Vec<Frame>, test: Vec<Frame>, space: Space) -> Self {
        Self {
            dir,
            format,
            train,
            test,
            split: None,
            selections: Vec::new(),
            protocols: Vec::new(),
            space,
            background: None,
            warnings: Vec::new(),
        }
    }
}

/// The views that a request chooses, with no image decoded.
struct Chosen<'f> {
    train: Vec<&'f Frame>,
    test: Vec<&'f Frame>,
    /// Size of the files.
    native: (u32, u32),
    /// Size asked for.
    size: (u32, u32),
    alpha: bool,
}

/// Chooses views. The size is that of the first. A view that is in both pools and chosen for training is left out of the
/// test, unless training views are what is to be tested.
fn choose<'f>(parts: &'f Parts<'_>, request: &SceneRequest) -> Result<Chosen<'f>, SceneError> {
    // Selection looks at poses alone, so that any size will do before one is known.
    let poses: Vec<Camera> = parts.train.iter().map(|f| f.camera(1, 1)).collect();
    let ids = |frames: &[Frame]| frames.iter().map(|f| f.id).collect::<Vec<_>>();
    let train = pool::train(&request.train, &poses, &ids(&parts.train), &parts.selections)?;
    let train = pick(&parts.train, &train);
    let test = if request.test == TestProtocol::Training {
        train.clone()
    } else {
        let test = pool::test(&request.test, &ids(&parts.test), parts.split.as_deref(), &parts.protocols)?;
        let mut test = pick(&parts.test, &test);
        test.retain(|t| train.iter().all(|f| f.image != t.image));
        test
    };
    if test.is_empty() {
        let expected = "at least one view that is not trained on (or `training`, to look at those that are)";
        return Err(SceneError::request("test", expected, "none"));
    }
    let Some(first) = train.first() else {
        return Err(SceneError::request("train", "at least one view", "none"));
    };
    let native = dimensions(&first.image)?;
    let size = match request.image_size {
        Some(longest) => resized_dimensions(native.0, native.1, longest.min(native.0.max(native.1))),
        None => native,
    };
    Ok(Chosen { alpha: has_alpha(&first.image)?, train, test, native, size })
}

/// How many pixels loading the chosen views gives.
pub(super) fn count_pixels(parts: &Parts<'_>, request: &SceneRequest) -> Result<PixelCount, SceneError> {
    let chosen = choose(parts, request)?;
    Ok(PixelCount::new(chosen.size, chosen.train.len(), chosen.test.len()))
}

/// Chooses views, reads their images in parallel and puts the scene together.
///
/// All chosen images must have the size of the first; a size that the poses state must be theirs.
pub(super) fn assemble(parts: Parts<'_>, request: &SceneRequest) -> Result<Scene, SceneError> {
    let Chosen { train, test, native, size, alpha } = choose(&parts, request)?;
    check_memory(parts.dir, size, train.len() + test.len(), alpha)?;
    let background = parts.background.unwrap_or(request.background);
    let read = |frames: &[&Frame]| -> Result<Vec<View>, SceneError> {
        let pixels = u64::from(native.0) * u64::from(native.1);
        let at_once = (MOST_AT_ONCE / pixels.max(1)).clamp(1, 1 << 16) as usize;
        let mut views = Vec::with_capacity(frames.len());
        for frames in frames.chunks(at_once) {
            let read: Vec<_> = frames.par_iter().map(|frame| read_view(frame, native, size, background)).collect();
            // The first fault in the order of the views, whichever thread met it first.
            for view in read {
                views.push(view?);
            }
        }
        Ok(views)
    };
    let (train, test) = (read(&train)?, read(&test)?);
    let mut warnings = parts.warnings;
    let bent = train.iter().chain(&test).filter(|v| lens_mask(&v.camera).is_some()).count();
    if bent > 0 {
        warnings.push(format!("the lens cannot be inverted at the border of {bent} views: those pixels do not count"));
    }
    let backdrop = if train.iter().all(|v| v.image.alpha.is_some() || v.image.has_border(background)) {
        Backdrop::Colour
    } else {
        Backdrop::Unknown
    };
    let mut space = parts.space;
    space.bounded |= backdrop == Backdrop::Colour && space.layout == Layout::Object;
    Ok(Scene {
        name: scene_name(parts.dir),
        train,
        test,
        format: parts.format,
        background,
        backdrop,
        space,
        all_train_cameras: parts.train.iter().map(|f| f.camera(native.0, native.1).resized(size.0, size.1)).collect(),
        warnings,
    }
    .with_guessed_background())
}

fn pick<'f>(frames: &'f [Frame], positions: &[usize]) -> Vec<&'f Frame> {
    positions.iter().filter_map(|&i| frames.get(i)).collect()
}

/// Refuses, before any is decoded, more images than memory should hold.
fn check_memory(dir: &Path, (width, height): (u32, u32), views: usize, alpha: bool) -> Result<(), SceneError> {
    let each = u64::from(width) * u64::from(height) * if alpha { 16 } else { 12 };
    let size = each.saturating_mul(views as u64);
    if size > MOST_BYTES {
        let what = "the memory for the chosen images in bytes (choose fewer views or a smaller image size)";
        return Err(SceneError::TooLarge { path: dir.into(), what, size, limit: MOST_BYTES });
    }
    Ok(())
}

fn read_view(frame: &Frame, native: (u32, u32), size: (u32, u32), background: [f32; 3]) -> Result<View, SceneError> {
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
    let mut rgba = read_rgba(&frame.image)?;
    let mut mask = None;
    if let Some((path, role)) = &frame.mask {
        let counts = read_mask(path, native)?;
        if *role == MaskRole::Matte {
            rgba.has_alpha = true;
            for (pixel, &inside) in rgba.pixels.iter_mut().zip(&counts) {
                pixel[3] = if inside { 1.0 } else { 0.0 };
            }
        }
        mask = Some(resized_mask(&counts, native, size));
    }
    let camera = frame.camera(native.0, native.1).resized(size.0, size.1);
    if let Some(covered) = lens_mask(&camera) {
        let whole = vec![true; covered.len()];
        mask = Some(mask.unwrap_or(whole).into_iter().zip(covered).map(|(a, b)| a && b).collect());
    }
    Ok(View {
        id: frame.id,
        name: frame.name.clone(),
        camera,
        image: Arc::new(rgba.composite_resized(size.0, size.1, background)),
        depth: depth.map(Into::into),
        mask: mask.map(Into::into),
    })
}

/// The folder's name, also for paths such as `.` that do not end in one.
pub(crate) fn scene_name(dir: &Path) -> String {
    let whole = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    whole.file_name().map_or_else(|| "scene".into(), |n| n.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_memory_should_hold_is_refused() {
        let dir = Path::new("capture");
        assert!(check_memory(dir, (4000, 3000), 26, false).is_ok());
        let text = check_memory(dir, (4000, 3000), 60, false).unwrap_err().to_string();
        assert!(text.starts_with("capture: the memory for the chosen images"), "{text}");
        assert!(check_memory(dir, (4000, 3000), 21, true).is_err());
        assert!(check_memory(dir, (u32::MAX, u32::MAX), usize::MAX, true).is_err());
    }
}
