//! Loading of a capture's views: selection, decoding, resizing, compositing.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use infonerf_scene::image::{dimensions, has_alpha, read_rgba, resized_mask};
use infonerf_scene::select::pool::{self, Named};
use infonerf_scene::{
    Backdrop, Camera, Image, Layout, MaskUse, PixelCount, Scene, SceneError, SceneRequest, TestProtocol, View,
    ViewSelection,
};
use rayon::prelude::*;

use super::mask::{check_valid, lens_mask, read_mask};
use super::plausible::implausible;
use super::sizes::ImageScale;
use super::{Capture, Found, StatedExtent, join_names, same_proportions, some_of};
use crate::files::npy::read_depth;
use crate::frame::{Frame, MaskRole};

/// Max memory of all chosen images together in bytes: 3.75 GiB.
pub(crate) const MAX_BYTES: u64 = 15 << 28;
/// Max number of pixels that are decoded at the same time, before they are resized.
const MAX_AT_ONCE: u64 = 24 << 20;
/// Max difference between the sides of an image and the stated ones that counts as cropping by undistortion, not as
/// scaling: in pixels, and divided by the stated side ([`MAX_TRIMMED`]).
const TRIMMED: f64 = 2.0;
const MAX_TRIMMED: f64 = 0.02;
/// Max number of pixels in the fingerprint by which candidates for equal images are found.
const FINGERPRINT: usize = 997;
/// Max distance between two cameras, divided by the scene's radius, and between their unit axes at which they count as one
/// camera: their images differ by a few pixels of a thousand, less than neighbouring frames of a moving video.
const SAME_CAMERA: f64 = 3e-3;
/// Side in pixels of the reduced images by which views of one camera are compared.
const THUMBNAIL: u32 = 16;
/// Correlation of reduced images above which two views of one camera show one photograph: photographs of three published
/// scenes and their copies with other tones and white balance have 0.95 to 1.
const SAME_PHOTOGRAPH: f32 = 0.94;

/// Views that a request chooses; no image is decoded yet.
struct Chosen<'f> {
    train: Vec<&'f Frame>,
    test: Vec<&'f Frame>,
    /// Cameras at the stored image sizes: of the training images, then of the test images.
    cameras: Vec<Camera>,
    scale: ImageScale,
    alpha: bool,
    warnings: Vec<String>,
}

/// Chooses views and their scale. A view in both pools that is chosen for training is not tested, unless the request
/// tests training views. In a capture, views without an image file are skipped unless they are requested by id or name.
/// In a published data set they are skipped only if all views are requested.
fn choose<'f>(found: &'f Found<'_>, request: &SceneRequest) -> Result<Chosen<'f>, SceneError> {
    let mut warnings = Vec::new();
    let selection = by_image_names(&request.train, &found.train, &found.selections)?;
    let all: Vec<&Frame> = found.train.iter().collect();
    let mut train = select(&selection, &all, &found.selections)?;
    let is_there = |frame: &&Frame| frame.image.is_file();
    let there: Vec<&Frame> = all.iter().copied().filter(is_there).collect();
    let is_capture = matches!(found.extent, StatedExtent::Estimated(_));
    let is_explicit = matches!(selection, ViewSelection::Ids { .. } | ViewSelection::Named { .. });
    if let Some(lost) = train.iter().find(|frame| !is_there(frame))
        && (selection == ViewSelection::All || is_capture && !is_explicit)
        && !there.is_empty()
    {
        let (count, total, path) = (all.len() - there.len(), all.len(), lost.image.display());
        warnings.push(format!(
            "{count} of {total} training images not found, such as {path}: views are chosen among the others"
        ));
        train = select(&selection, &there, &found.selections)?;
    }
    let test = if request.test == TestProtocol::Training {
        train.clone()
    } else {
        let ids: Vec<usize> = found.test.iter().map(|frame| frame.id).collect();
        let chosen = pool::test(&request.test, &ids, found.split.as_deref(), &found.protocols)?;
        let mut test: Vec<&Frame> = chosen.into_iter().map(|i| &found.test[i]).collect();
        test.retain(|t| train.iter().all(|f| f.image != t.image));
        let lost: Vec<&Frame> = test.iter().copied().filter(|frame| !is_there(frame)).collect();
        if let Some(first) = lost.first()
            && lost.len() < test.len()
            && (request.test == TestProtocol::All || is_capture && !matches!(request.test, TestProtocol::Ids(_)))
        {
            let (count, total, path) = (lost.len(), test.len(), first.image.display());
            warnings.push(format!("{count} of {total} test images not found, such as {path}"));
            test.retain(is_there);
        }
        test
    };
    let none = || SceneError::request("train", "at least one view", "none");
    // A missing file comes before the faults that it leads to.
    let alpha = has_alpha(&train.first().ok_or_else(none)?.image)?;
    if test.is_empty() {
        let expected = "at least one view that is not trained on (or `training`, to look at those that are)";
        return Err(SceneError::request("test", expected, "none"));
    }
    let frames: Vec<&Frame> = train.iter().chain(&test).copied().collect();
    let cameras = in_order(frames.par_iter().map(|frame| stored_camera(frame)))?;
    let scale = ImageScale::new(&cameras, request.image_size).ok_or_else(none)?;
    Ok(Chosen { alpha, train, test, cameras, scale, warnings })
}

/// Replaces names of images, with or without folder and extension, by the ids of their frames. A single name that no image has
/// is left to the selections that the format knows.
fn by_image_names(selection: &ViewSelection, frames: &[Frame], known: &Named) -> Result<ViewSelection, SceneError> {
    let ViewSelection::Named { name: text } = selection else { return Ok(selection.clone()) };
    let named = |name: &str| -> Vec<&Frame> {
        let parts = |frame: &Frame| [frame.image.file_name(), frame.image.file_stem()].contains(&Some(name.as_ref()));
        let whole: Vec<&Frame> = frames.iter().filter(|frame| frame.name == name).collect();
        if whole.is_empty() { frames.iter().filter(|frame| parts(frame)).collect() } else { whole }
    };
    // A name may have a comma itself.
    let names: Vec<&str> = if named(text).is_empty() { text.split(',').collect() } else { vec![text.as_str()] };
    if known.iter().any(|(name, _)| name == text) || names.len() == 1 && named(text).is_empty() {
        return Ok(selection.clone());
    }
    let id = |name: &&str| {
        let (expected, several) = match &named(name)[..] {
            [frame] => return Ok(frame.id),
            [] => (frames.first().map_or("", |frame| &frame.name).to_owned(), ""),
            all => (join_names(all.iter().map(|frame| frame.name.as_str())), ", which several have"),
        };
        let expected = format!("names of training images, such as {expected}");
        Err(SceneError::request("train", expected, format!("`{name}`{several}")))
    };
    Ok(ViewSelection::Ids { ids: names.iter().map(id).collect::<Result<_, _>>()? })
}

/// Returns the selected `frames`. Rules depend on poses only, so the cameras get a size of 1×1 pixels.
fn select<'f>(selection: &ViewSelection, frames: &[&'f Frame], known: &Named) -> Result<Vec<&'f Frame>, SceneError> {
    let poses: Vec<Camera> = frames.iter().map(|frame| frame.camera(1, 1)).collect();
    let ids: Vec<usize> = frames.iter().map(|frame| frame.id).collect();
    Ok(pool::train(selection, &poses, &ids, known)?.into_iter().map(|i| frames[i]).collect())
}

/// Returns the camera at the stored size of the image. If both sides differ from the stated ones by at most [`TRIMMED`]
/// pixels, the image counts as cropped at the right and bottom; otherwise the intrinsics are scaled.
fn stored_camera(frame: &Frame) -> Result<Camera, SceneError> {
    let found = dimensions(&frame.image)?;
    let Some(stated) = frame.stated_size() else { return Ok(frame.camera(found.0, found.1)) };
    let trimmed = |found: u32, stated: u32| {
        let lacking = (f64::from(stated) - f64::from(found)).abs();
        lacking <= TRIMMED && lacking <= MAX_TRIMMED * f64::from(stated)
    };
    if trimmed(found.0, stated.0) && trimmed(found.1, stated.1) {
        return Ok(Camera { width: found.0, height: found.1, ..frame.camera(stated.0, stated.1) });
    }
    if same_proportions(found, stated) {
        return Ok(frame.camera(found.0, found.1));
    }
    let expected =
        format!("an image of {}×{} pixels (or of these proportions), which its camera is for", stated.0, stated.1);
    Err(SceneError::malformed(&frame.image, expected, format!("it has {}×{}", found.0, found.1)))
}

pub(crate) fn count_pixels(found: Found<'_>, request: &SceneRequest) -> Result<PixelCount, SceneError> {
    let Capture { found, .. } = found.prepared()?;
    let chosen = choose(&found, request)?;
    Ok(PixelCount::new(chosen.scale.canvas, chosen.train.len(), chosen.test.len()))
}

/// Chooses views, reads their images in parallel and builds the scene.
///
/// Views without a valid pixel, and test views that show the photograph of a training view, are left out with a warning, and if
/// `needs_depths` also the exact depths of resized images.
pub(crate) fn assemble(found: Found<'_>, request: &SceneRequest, needs_depths: bool) -> Result<Scene, SceneError> {
    let Capture { mut found, mut space, origin } = found.prepared()?;
    let (mut warnings, notes) = (std::mem::take(&mut found.warnings), std::mem::take(&mut found.notes));
    let Chosen { train, test: chosen_test, cameras, scale, alpha, warnings: left_out } = choose(&found, request)?;
    check_memory(found.dir, scale.canvas, train.len() + chosen_test.len(), alpha)?;
    let background = found.background.unwrap_or(request.background);
    let by_stored = found.is_by_stored();
    let reader = Reader { dir: found.dir, scale: &scale, background, masks: request.masks, by_stored };
    let (train_cameras, test_cameras) = cameras.split_at(train.len());
    let (mut train_views, shown) = reader.views(&train, train_cameras)?;
    let (mut test, test_shown) = reader.views(&chosen_test, test_cameras)?;
    warnings.extend(mixed_alpha(train_views.iter().zip(&shown).chain(test.iter().zip(&test_shown)).collect()));
    if shown.iter().all(|[_, is_opaque]| *is_opaque) {
        // An alpha channel that hides nothing is no matte.
        train_views.iter_mut().chain(&mut test).for_each(|view| Arc::make_mut(&mut view.image).alpha = None);
    }
    let names: Vec<&str> = train.iter().chain(&chosen_test).map(|frame| frame.name.as_str()).collect();
    warnings.extend(implausible(&names, &cameras));
    warnings.extend(scaled(&train, train_cameras));
    warnings.extend(left_out);
    let tested: &[&Frame] = if request.test == TestProtocol::Training { &[] } else { &chosen_test };
    warnings.extend(mixed_sizes_warning(&cameras[..train.len() + tested.len()], &scale));
    let stored = train.iter().chain(tested).zip(&cameras);
    let resized = stored.filter(|(_, camera)| (camera.width, camera.height) != scale.canvas);
    let lost = resized.filter(|(frame, _)| frame.depth.is_some()).count();
    let all = train.len() + tested.len();
    warnings.extend((needs_depths && lost > 0).then(|| {
        let used = "depths are used only where images keep their stored size (`scene.size = 0`)";
        format!("exact depths of {lost} of {all} views are left out: {used}")
    }));
    let is_known = train_views.iter().zip(shown).all(|(view, [border, _])| view.image.alpha.is_some() || border);
    warnings.extend(check_valid(&train, &mut train_views, &mut test)?);
    if request.test != TestProtocol::Training {
        warnings.extend(leave_out_copies(&train_views, &mut test, space.radius));
    }
    let tested: HashSet<&Path> = tested.iter().map(|frame| frame.image.as_path()).collect();
    let others = found.train.iter().filter(|frame| !tested.contains(frame.image.as_path()));
    let base = scale.base_size();
    let stated = train.iter().zip(train_cameras).find(|(_, camera)| (camera.width, camera.height) == base);
    let stated = stated.and_then(|(frame, _)| frame.stated_size());
    let all_train_cameras = others.map(|frame| scale.framed(&assumed_camera(frame, base, stated))).collect();
    let backdrop = if is_known { Backdrop::Colour } else { Backdrop::Unknown };
    space.bounded |= backdrop == Backdrop::Colour && space.layout == Layout::Object;
    let (name, format) = (scene_name(found.dir), found.format);
    let scene = Scene { name, format, background, backdrop, space, origin, warnings, notes, ..Scene::default() };
    Ok(Scene { train: train_views, test, all_train_cameras, ..scene }.with_guessed_background())
}

/// Returns the camera of a frame without opening its image. `stated` is the stated size of images whose stored size is
/// `base`. Any other stated size is scaled by base.0 / stated.0; else the camera is for `base`.
fn assumed_camera(frame: &Frame, base: (u32, u32), stated: Option<(u32, u32)>) -> Camera {
    let size = match (frame.stated_size(), stated) {
        (Some(own), Some(of_base)) if own != of_base => {
            let side = |side: u32| (f64::from(side) * f64::from(base.0) / f64::from(of_base.0)).round().max(1.0) as u32;
            (side(own.0), side(own.1))
        }
        _ => base,
    };
    frame.camera(size.0, size.1)
}

/// Returns a warning if cameras are stated for images of another size.
fn scaled(frames: &[&Frame], cameras: &[Camera]) -> Option<String> {
    let differs = |(frame, camera): (&&Frame, &Camera)| {
        let found = (camera.width, camera.height);
        let stated = frame.stated_size()?;
        (frame.camera(stated.0, stated.1).fx != camera.fx).then_some((stated, found))
    };
    let ((width, height), found) = frames.iter().zip(cameras).find_map(differs)?;
    let found = format!("{}×{}", found.0, found.1);
    Some(format!("the cameras are for images of {width}×{height} pixels, these have {found}: they are scaled"))
}

/// Returns a warning if images with transparent pixels stand next to images without alpha on another background. Each
/// view is given with whether its border has the background's colour, and whether all its pixels are opaque.
fn mixed_alpha(views: Vec<(&View, &[bool; 2])>) -> Option<String> {
    let transparent = views.iter().filter(|(_, [_, is_opaque])| !is_opaque).count();
    let mut others = views.iter().filter(|(view, [border, _])| view.image.alpha.is_none() && !border);
    let (first, count) = (&others.next()?.0.file, 1 + others.count());
    let effect = "there the background is taken as part of the photograph";
    let text = format!("images with transparency: {transparent}, without: {count}, such as {first}; {effect}");
    (transparent > 0).then_some(text)
}

fn mixed_sizes_warning(cameras: &[Camera], scale: &ImageScale) -> Option<String> {
    let mut counts: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    cameras.iter().for_each(|camera| *counts.entry((camera.width, camera.height)).or_default() += 1);
    let described = counts.iter().rev().map(|((width, height), count)| format!("{count} of {width}×{height}"));
    let (described, (width, height)) = (described.collect::<Vec<_>>().join(", "), scale.canvas);
    let text = format!(
        "images of several sizes ({described}) are brought to one scale, in the middle of {width}×{height} pixels; what \
         is outside of them is neither trained on nor measured"
    );
    (counts.len() > 1).then_some(text)
}

/// Whether two views have nearly one camera and show one photograph in two encodings, or before and after an edit.
fn is_edited(a: &View, b: &View, radius: f32) -> bool {
    let apart = a.camera.position_f64().distance(b.camera.position_f64());
    let turned = a.camera.forward_f64().distance(b.camera.forward_f64());
    if apart > SAME_CAMERA * f64::from(radius) || turned > SAME_CAMERA {
        return false;
    }
    let [a, b] = [a, b].map(|view| {
        let small = view.image.resized(THUMBNAIL, THUMBNAIL);
        let mean = small.rgb.as_flattened().iter().sum::<f32>() / (3 * THUMBNAIL * THUMBNAIL) as f32;
        small.rgb.into_iter().flatten().map(|value| value - mean).collect::<Vec<f32>>()
    });
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    // The lower bound keeps blank images, whose correlation is 0/0, from counting as one photograph.
    dot(&a, &b) > SAME_PHOTOGRAPH * (dot(&a, &a) * dot(&b, &b)).sqrt().max(1e-3)
}

/// Removes test views that show the photograph of a training view, unless all test views do. Returns warnings of these,
/// and of training views that show one photograph. Images show one if they are equal, or by [`is_edited`].
fn leave_out_copies(train: &[View], test: &mut Vec<View>, radius: f32) -> Vec<String> {
    let fingerprint = |view: &View| {
        let step = view.image.rgb.len().div_ceil(FINGERPRINT).max(1);
        view.image.rgb.iter().step_by(step).flatten().map(|value| value.to_bits()).collect::<Vec<u32>>()
    };
    let is_copy = |view: &View, other: &View| {
        other.image == view.image && view.image.rgb.iter().any(|pixel| *pixel != view.image.rgb[0])
    };
    let mut known: HashMap<Vec<u32>, &View> = HashMap::new();
    let (mut twice, mut pairs) = (Vec::new(), Vec::new());
    for (i, view) in train.iter().enumerate() {
        let equal = known.insert(fingerprint(view), view).filter(|other| is_copy(view, other));
        match equal.or_else(|| train[..i].iter().find(|other| is_edited(view, other, radius))) {
            Some(other) if other.file == view.file => twice.push(&view.file),
            Some(other) => pairs.push(format!("{} of {}", view.file, other.file)),
            None => {}
        }
    }
    let copies = "training views show the photograph of another one, with a camera of their own";
    let listed = some_of(&twice, train.len(), "training views are listed twice");
    let mut warnings = Vec::from_iter(listed.into_iter().chain(some_of(&pairs, train.len(), copies)));
    let original = |view: &View| {
        let equal = known.get(&fingerprint(view)).copied().filter(|other| is_copy(view, other));
        equal.or_else(|| train.iter().find(|other| is_edited(view, other, radius))).map(|other| &other.file)
    };
    if test.iter().all(|view| original(view).is_some()) {
        let text = "all test views are copies of training views: they show nothing of how new views will look";
        warnings.push(text.into());
        return warnings;
    }
    test.retain(|view| {
        let copied = original(view);
        let warning = |name| format!("{} is a copy of {name}, which is trained on: it is not tested", view.file);
        warnings.extend(copied.map(warning));
        copied.is_none()
    });
    warnings
}

/// Returns an error if the chosen images would take more than [`MAX_BYTES`] of memory; none is decoded before.
fn check_memory(dir: &Path, (width, height): (u32, u32), views: usize, alpha: bool) -> Result<(), SceneError> {
    let each = (u64::from(width) * u64::from(height)).saturating_mul(if alpha { 16 } else { 12 });
    let size = each.saturating_mul(views as u64);
    if size > MAX_BYTES {
        let what = "the memory for the chosen images in bytes (fewer are chosen by `scene.views`, smaller ones by `scene.size`)";
        return Err(SceneError::TooLarge { path: dir.into(), what, size, limit: MAX_BYTES });
    }
    Ok(())
}

/// Collects results of a parallel computation, or returns the error of lowest index, whichever thread failed first.
pub(crate) fn in_order<T: Send>(
    results: impl IndexedParallelIterator<Item = Result<T, SceneError>>,
) -> Result<Vec<T>, SceneError> {
    results.collect::<Vec<_>>().into_iter().collect()
}

struct Reader<'a> {
    dir: &'a Path,
    scale: &'a ImageScale,
    background: [f32; 3],
    masks: MaskUse,
    /// Whether cameras are for the stored pixels of images that EXIF data turn, if no size tells.
    by_stored: bool,
}

impl Reader<'_> {
    /// Reads views, each with whether its border has the background's colour, and whether all its pixels are opaque.
    /// `cameras` are for the stored image sizes.
    fn views(&self, frames: &[&Frame], cameras: &[Camera]) -> Result<(Vec<View>, Vec<[bool; 2]>), SceneError> {
        let pixels = |camera: &Camera| u64::from(camera.width) * u64::from(camera.height);
        let largest = cameras.iter().map(pixels).max().unwrap_or(1).max(1);
        let at_once = (MAX_AT_ONCE / largest).clamp(1, 1 << 16) as usize;
        let mut views = Vec::with_capacity(frames.len());
        for (frames, cameras) in frames.chunks(at_once).zip(cameras.chunks(at_once)) {
            views.extend(in_order(frames.par_iter().zip(cameras).map(|(frame, camera)| self.view(frame, camera)))?);
        }
        Ok(views.into_iter().unzip())
    }

    fn view(&self, frame: &Frame, stored: &Camera) -> Result<(View, [bool; 2]), SceneError> {
        let (native, size, canvas) = ((stored.width, stored.height), self.scale.size(stored), self.scale.canvas);
        let depth = frame.depth.as_ref().filter(|_| canvas == native);
        let depth = depth.map(|path| read_depth(path, native)).transpose()?;
        let mut rgba = read_rgba(&frame.image)?;
        let mut mask: Option<Vec<bool>> = None;
        let mut valid = (size != canvas).then(|| vec![true; (size.0 * size.1) as usize]);
        if let Some(file @ (_, role)) = &frame.mask {
            let counts = read_mask(&frame.image, file, native, self.by_stored)?;
            if *role == MaskRole::Matte {
                rgba.has_alpha = true;
                rgba.pixels.iter_mut().zip(&counts).for_each(|(pixel, &inside)| pixel[3] = inside.into());
            }
            let counts = resized_mask(&counts, native, size);
            if matches!(role, MaskRole::Capture | MaskRole::Dynamic) && self.masks == MaskUse::LeaveOut {
                valid = Some(counts.clone());
            }
            mask = Some(counts);
        }
        if let Some(covered) = lens_mask(&stored.resized(size.0, size.1)) {
            let left = |i: usize| valid.as_ref().is_none_or(|valid| valid[i]);
            valid = Some(covered.iter().enumerate().map(|(i, &covered)| covered && left(i)).collect());
        }
        let file = frame.image.strip_prefix(self.dir).unwrap_or(&frame.image).to_string_lossy().into_owned();
        let image = rgba.composite_resized(size.0, size.1, self.background);
        let shown = [image.has_border(self.background), rgba.pixels.iter().all(|pixel| pixel[3] == 1.0)];
        let image = if size == canvas { image } else { self.framed(image) };
        let on_canvas = |flags: Vec<bool>| -> Arc<[bool]> {
            if size == canvas { flags.into() } else { padded(&flags, size, canvas, false).into() }
        };
        let (mask, valid) = (mask.map(on_canvas), valid.map(on_canvas));
        let view = View::new(frame.id, frame.name.clone(), self.scale.framed(stored), image);
        Ok((View { file, depth: depth.map(Into::into), mask, valid, ..view }, shown))
    }

    /// Centres an image on a canvas of the background's colour.
    fn framed(&self, image: Image) -> Image {
        let (size, canvas) = ((image.width, image.height), self.scale.canvas);
        let rgb = padded(&image.rgb, size, canvas, self.background);
        let alpha = image.alpha.map(|alpha| padded(&alpha, size, canvas, 0.0));
        Image { width: canvas.0, height: canvas.1, rgb, alpha }
    }
}

/// Centres row-major `values` on a canvas that is filled with `fill`.
fn padded<T: Copy>(values: &[T], size: (u32, u32), canvas: (u32, u32), fill: T) -> Vec<T> {
    let (left, top) = (((canvas.0 - size.0) / 2) as usize, ((canvas.1 - size.1) / 2) as usize);
    let mut out = vec![fill; canvas.0 as usize * canvas.1 as usize];
    for (y, row) in values.chunks_exact(size.0 as usize).enumerate() {
        out[(top + y) * canvas.0 as usize + left..][..row.len()].copy_from_slice(row);
    }
    out
}

/// Returns the folder's name, also for paths such as `.` that do not end in one.
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
