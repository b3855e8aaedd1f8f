//! Masks: search, reading, and the valid pixels of a view.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use infonerf_scene::image::{find_image, read_rgba, resized_mask};
use infonerf_scene::{Camera, Format, SceneError, View};

use super::same_proportions;
use crate::frame::{Frame, MaskRole};

/// Prefix of instant-ngp's mask of an image, in the same folder; its white pixels are left out.
const DYNAMIC: &str = "dynamic_mask_";

pub(crate) fn is_mask_name(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(DYNAMIC.as_bytes()))
}

/// Assigns masks to the frames of a capture that have none. A mask is in `masks` (or `masks_4` for `images_4`) next to
/// the folder of images, under the image's name with another extension or with `.png` appended; or it is instant-ngp's
/// `dynamic_mask_NAME.png` next to the image. Returns a warning with the number of masks.
pub(super) fn find_masks(dir: &Path, format: Format, train: &mut [Frame], test: &mut [Frame]) -> Option<String> {
    if matches!(format, Format::Dtu | Format::Zju) {
        return None;
    }
    let mut found: BTreeSet<PathBuf> = BTreeSet::new();
    for frame in train.iter_mut().chain(test.iter_mut()).filter(|frame| frame.mask.is_none()) {
        frame.mask = mask_of(dir, &frame.image);
        found.extend(frame.mask.iter().map(|(path, _)| path.clone()));
    }
    let first = found.first()?;
    let images: BTreeSet<&Path> = train.iter().chain(test.iter()).map(|frame| frame.image.as_path()).collect();
    let first = first.strip_prefix(dir).unwrap_or(first).display();
    Some(format!("{} of {} images have masks, such as {first}", found.len(), images.len()))
}

/// Returns the mask of an image of the capture in `dir`, if there is one.
pub(crate) fn mask_of(dir: &Path, image: &Path) -> Option<(PathBuf, MaskRole)> {
    let is_image_folder = |folder: &&Path| {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("images") || name == "input"
    };
    let folder = image.ancestors().skip(1).take_while(|folder| folder.starts_with(dir)).find(is_image_folder);
    let (root, below) = match folder {
        Some(folder) => (folder.parent()?, image.strip_prefix(folder).ok()?),
        None => (dir, image.strip_prefix(dir).ok()?),
    };
    let reduced = folder.and_then(|folder| folder.file_name()?.to_str()?.strip_prefix("images"));
    for masks in [format!("masks{}", reduced.unwrap_or_default()), "masks".to_owned()] {
        let path = root.join(masks).join(below);
        let with_png = path.with_file_name(format!("{}.png", path.file_name()?.to_string_lossy()));
        let there = find_image(&path).filter(|found| found != image);
        if let Some(mask) = there.or_else(|| with_png.is_file().then_some(with_png)) {
            return Some((mask, MaskRole::Capture));
        }
    }
    let stem = image.file_stem()?.to_string_lossy();
    let dynamic = image.with_file_name(format!("{DYNAMIC}{stem}.png"));
    dynamic.is_file().then_some((dynamic, MaskRole::Dynamic))
}

/// Reads which pixels of an image of `size` count, row-major. A capture's mask of the same proportions is resized.
///
/// A pixel counts if it is not black. In a capture's mask it counts if it is brighter than half the brightest pixel:
/// this rejects JPEG noise in black areas and accepts masks of zeros and ones.
pub(crate) fn read_mask(path: &Path, role: MaskRole, size: (u32, u32)) -> Result<Vec<bool>, SceneError> {
    let image = read_rgba(path)?;
    let found = (image.width, image.height);
    let is_capture = matches!(role, MaskRole::Capture | MaskRole::Dynamic);
    if found != size && !(is_capture && same_proportions(found, size)) {
        let expected = format!("a mask of {}×{} pixels like its image", size.0, size.1);
        return Err(SceneError::malformed(path, expected, format!("it has {}×{}", found.0, found.1)));
    }
    let brightness =
        |&[r, g, b, a]: &[f32; 4]| if a > 0.0 { r.max(g).max(b) * if is_capture { a } else { 1.0 } } else { 0.0 };
    let threshold = if is_capture { 0.5 * image.pixels.iter().map(brightness).fold(0.0, f32::max) } else { 0.0 };
    let counts = image.pixels.iter().map(|pixel| (brightness(pixel) > threshold) != (role == MaskRole::Dynamic));
    Ok(resized_mask(&counts.collect::<Vec<bool>>(), found, size))
}

/// Returns whether the image's border has pixels for which the lens cannot be inverted.
fn exceeds_lens(camera: &Camera) -> bool {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let shares = [0.0, 0.5, 1.0];
    let mut border = shares.iter().flat_map(|x| shares.iter().map(move |y| (x * w, y * h)));
    !camera.lens.is_perspective() && border.any(|(x, y)| !camera.covers(x, y))
}

/// Returns which pixels have a known ray, row-major; `None` if all do.
pub(super) fn lens_mask(camera: &Camera) -> Option<Vec<bool>> {
    let covers = |x: u32, y: u32| camera.covers(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let row = |y: u32| (0..camera.width).map(move |x| covers(x, y));
    exceeds_lens(camera).then(|| (0..camera.height).flat_map(row).collect())
}

/// Removes views without a valid pixel from `test`. Returns warnings of the pixels and views that are left out.
pub(super) fn check_valid(frames: &[&Frame], train: &[View], test: &mut Vec<View>) -> Result<Vec<String>, SceneError> {
    let is_blank = |view: &View| view.valid.as_ref().is_some_and(|valid| !valid.contains(&true));
    if let Some((frame, _)) = frames.iter().zip(train).find(|(_, view)| is_blank(view)) {
        let file = frame.mask.as_ref().map_or(&frame.image, |(mask, _)| mask);
        let expected = "a mask that leaves pixels to train on (or `scene.masks = \"score\"`)";
        return Err(SceneError::malformed(file, expected, "all are black"));
    }
    let mut warnings = Vec::new();
    let blank: Vec<String> = test.extract_if(.., |view| is_blank(view)).map(|view| view.name).collect();
    if !blank.is_empty() {
        warnings.push(format!("masks leave no pixel of the test views {}: they are not tested", blank.join(", ")));
    }
    if test.is_empty() {
        return Err(SceneError::request("test", "a view whose mask is not black throughout", "none"));
    }
    let partial = train.iter().chain(&*test).filter(|view| view.valid.is_some());
    let (bent, whole): (Vec<&View>, Vec<&View>) = partial.partition(|view| exceeds_lens(&view.camera));
    let masked = whole.into_iter().filter(|view| view.mask.is_some()).collect();
    for (what, views) in [("the lens cannot be inverted at the border", bent), ("masks leave out pixels", masked)] {
        if !views.is_empty() {
            let count = views.len();
            warnings.push(format!("{what} of {count} views: those pixels are neither trained on nor measured"));
        }
    }
    Ok(warnings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use infonerf_scene::{Lens, Rgba8};

    #[test]
    fn masks_are_read_by_their_role() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        let write = |values: [u8; 2]| {
            let pixels = values.map(|v| [v, v, v, 255]).to_vec();
            Rgba8 { width: 2, height: 1, pixels }.write_png(&path).unwrap();
        };
        let read = |role| read_mask(&path, role, (2, 1)).unwrap();
        // Values of a mask: labels of body parts, JPEG noise in a black area, zeros and ones.
        for (values, counts, capture) in [
            ([0, 9], [false, true], [false, true]),
            ([9, 255], [true; 2], [false, true]),
            ([0, 1], [false, true], [false, true]),
        ] {
            write(values);
            assert_eq!(read(MaskRole::Counts), counts);
            assert_eq!(read(MaskRole::Capture), capture);
            assert_eq!(read(MaskRole::Dynamic), capture.map(|c| !c));
        }
        assert_eq!(read_mask(&path, MaskRole::Capture, (4, 2)).unwrap()[4..], [false, false, true, true]);
        assert!(read_mask(&path, MaskRole::Counts, (4, 2)).unwrap_err().to_string().contains("it has 2×1"));
        assert!(read_mask(&path, MaskRole::Capture, (1, 2)).unwrap_err().to_string().contains("it has 2×1"));
    }

    #[test]
    fn masks_of_every_spelling_are_found() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        for (image, mask, role) in [
            ("images/a.jpg", "masks/a.png", MaskRole::Capture),
            ("images/v/b.png", "masks/v/b.png.png", MaskRole::Capture),
            ("images_4/c.png", "masks_4/c.png", MaskRole::Capture),
            ("dense/0/images/d.png", "dense/0/masks/d.png", MaskRole::Capture),
            ("e.png", "masks/e.png", MaskRole::Capture),
            ("train/f.png", "train/dynamic_mask_f.png", MaskRole::Dynamic),
        ] {
            let (image, mask) = (dir.join(image), dir.join(mask));
            assert_eq!(mask_of(dir, &image), None);
            std::fs::create_dir_all(mask.parent().unwrap()).unwrap();
            std::fs::write(&mask, "").unwrap();
            assert_eq!(mask_of(dir, &image), Some((mask, role)));
        }
    }

    #[test]
    fn pixels_beyond_the_lens_do_not_count() {
        let camera = Camera::from_fov(20, 20, 1.5, glam::DMat4::IDENTITY);
        assert_eq!(lens_mask(&camera), None);
        let bent = camera.with_lens(Lens::radial_tangential([-0.3, 0.0, 0.0, 0.0], [0.0; 2]));
        let mask = lens_mask(&bent).unwrap();
        assert!(mask[10 * 20 + 10] && !mask[0]);
    }
}
