//! From lists of frames to a scene: selection, decoding, resizing, compositing.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use infonerf_scene::image::{dimensions, has_alpha, read_rgba, resized_dimensions, resized_mask};
use infonerf_scene::select::pool::{self, Named};
use infonerf_scene::{
    Backdrop, Camera, Format, Layout, MaskUse, PixelCount, Scene, SceneError, SceneRequest, Space, TestProtocol, View,
};
use rayon::prelude::*;

use super::depth::read_depth;
use super::frames::Frame;
use super::mask::{MaskRole, check_valid, lens_mask, read_mask};

/// The most that the chosen images may take in memory together, in bytes: 3.75 GiB.
const MOST_BYTES: u64 = 15 << 28;
/// How much the proportions of an image may differ from those of the size that its camera is for: rounding.
const PROPORTIONS: f64 = 0.01;
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
    /// Warnings for the user.
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
/// All chosen images must have one size, and the size that their cameras are for, if that is known, its proportions. Test
/// views without a valid pixel are left out, with a warning.
pub(super) fn assemble(parts: Parts<'_>, request: &SceneRequest) -> Result<Scene, SceneError> {
    let Chosen { train, test: chosen_test, native, size, alpha } = choose(&parts, request)?;
    check_memory(parts.dir, size, train.len() + chosen_test.len(), alpha)?;
    check_sizes(train.iter().chain(&chosen_test))?;
    let background = parts.background.unwrap_or(request.background);
    let read = |frames: &[&Frame]| -> Result<Vec<View>, SceneError> {
        let pixels = u64::from(native.0) * u64::from(native.1);
        let at_once = (MOST_AT_ONCE / pixels.max(1)).clamp(1, 1 << 16) as usize;
        let mut views = Vec::with_capacity(frames.len());
        for frames in frames.chunks(at_once) {
            let read =
                frames.par_iter().map(|frame| read_view(frame, parts.dir, native, size, background, request.masks));
            let read: Vec<_> = read.collect();
            // The first fault in the order of the views, whichever thread met it first.
            for view in read {
                views.push(view?);
            }
        }
        Ok(views)
    };
    let scaled = train.iter().find_map(|frame| frame.stated_size().filter(|stated| *stated != native));
    let (views, mut test) = (read(&train)?, read(&chosen_test)?);
    let left_out = check_valid(&train, &views, &mut test)?;
    let train = views;
    let tested: HashSet<&Path> = match request.test {
        TestProtocol::Training => HashSet::new(),
        _ => chosen_test.iter().map(|frame| frame.image.as_path()).collect(),
    };
    let others = parts.train.iter().filter(|frame| !tested.contains(frame.image.as_path()));
    let all_train_cameras = others.map(|f| f.camera(native.0, native.1).resized(size.0, size.1)).collect();
    let mut warnings = parts.warnings;
    if let Some((width, height)) = scaled {
        let found = format!("{}×{}", native.0, native.1);
        warnings.push(format!(
            "the cameras are for images of {width}×{height} pixels, these have {found}: they are scaled"
        ));
    }
    warnings.extend(left_out);
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
        all_train_cameras,
        exact_cameras: None,
        unrefined_cameras: None,
        warnings,
    }
    .with_guessed_background())
}

fn pick<'f>(frames: &'f [Frame], positions: &[usize]) -> Vec<&'f Frame> {
    positions.iter().filter_map(|&i| frames.get(i)).collect()
}

/// Refuses, before any is decoded, more images than memory should hold.
fn check_memory(dir: &Path, (width, height): (u32, u32), views: usize, alpha: bool) -> Result<(), SceneError> {
    let each = (u64::from(width) * u64::from(height)).saturating_mul(if alpha { 16 } else { 12 });
    let size = each.saturating_mul(views as u64);
    if size > MOST_BYTES {
        let what = "the memory for the chosen images in bytes (choose fewer views or a smaller image size)";
        return Err(SceneError::TooLarge { path: dir.into(), what, size, limit: MOST_BYTES });
    }
    Ok(())
}

/// Refuses the first image whose size is not that of most, or has not the proportions that its camera is for.
fn check_sizes<'f>(frames: impl Iterator<Item = &'f &'f Frame>) -> Result<(), SceneError> {
    let frames: Vec<&Frame> = frames.copied().collect();
    let sizes: Vec<_> = frames.par_iter().map(|frame| dimensions(&frame.image)).collect();
    let sizes = sizes.into_iter().collect::<Result<Vec<_>, _>>()?;
    let others = |size: &(u32, u32)| sizes.iter().filter(|other| *other == size).count();
    let Some(&most) = sizes.iter().rev().max_by_key(|size| others(size)) else { return Ok(()) };
    for (frame, found) in frames.iter().zip(&sizes) {
        let refuse = |(width, height): (u32, u32), why: String| {
            let reason = format!("it has {}×{}", found.0, found.1);
            Err(SceneError::malformed(&frame.image, format!("an image of {width}×{height} pixels {why}"), reason))
        };
        if *found != most {
            return refuse(most, format!("like {} of {} chosen ones", others(&most), sizes.len()));
        }
        if let Some(stated) = frame.stated_size() {
            let ratio = f64::from(found.0) * f64::from(stated.1) / (f64::from(found.1) * f64::from(stated.0));
            if (ratio - 1.0).abs() > PROPORTIONS {
                return refuse(stated, "(or of these proportions), which its camera is for".into());
            }
        }
    }
    Ok(())
}

fn read_view(
    frame: &Frame,
    dir: &Path,
    native: (u32, u32),
    size: (u32, u32),
    background: [f32; 3],
    masks: MaskUse,
) -> Result<View, SceneError> {
    let depth = match &frame.depth {
        Some(path) if size == native => Some(read_depth(path, native.0, native.1)?),
        _ => None,
    };
    let mut rgba = read_rgba(&frame.image)?;
    let (mut mask, mut valid) = (None, None);
    if let Some((path, role)) = &frame.mask {
        let counts = read_mask(path, native)?;
        if *role == MaskRole::Matte {
            rgba.has_alpha = true;
            for (pixel, &inside) in rgba.pixels.iter_mut().zip(&counts) {
                pixel[3] = if inside { 1.0 } else { 0.0 };
            }
        }
        let counts: Arc<[bool]> = resized_mask(&counts, native, size).into();
        valid = (*role == MaskRole::Capture && masks == MaskUse::LeaveOut).then(|| counts.clone());
        mask = Some(counts);
    }
    let camera = frame.camera(native.0, native.1).resized(size.0, size.1);
    if let Some(covered) = lens_mask(&camera) {
        let left = |i: usize| valid.as_ref().is_none_or(|valid| valid[i]);
        valid = Some(covered.iter().enumerate().map(|(i, &covered)| covered && left(i)).collect());
    }
    let file = frame.image.strip_prefix(dir).unwrap_or(&frame.image).to_string_lossy().into_owned();
    let image = rgba.composite_resized(size.0, size.1, background);
    let depth = depth.map(Into::into);
    Ok(View { file, depth, mask, valid, ..View::new(frame.id, frame.name.clone(), camera, image) })
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
