//! Masks: search, reading, and the valid pixels of a view.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use infonerf_scene::image::{
    Orientation, find_image, list_images, orientation, read_rgba_turned, resized_mask, stored_dimensions,
};
use infonerf_scene::{Camera, Format, SceneError, View};

use super::same_proportions;
use crate::files::{entries, file_name};
use crate::frame::{Frame, MaskRole};

/// Prefix of instant-ngp's mask of an image, in the same folder; its white pixels are left out.
const DYNAMIC: &str = "dynamic_mask_";
/// Names of folders of images at full size: COLMAP's, the input of 3DGS' scripts, frames of videos, and other usual names.
pub(crate) const IMAGE_FOLDERS: [&str; 7] = ["images", "input", "photos", "rgb", "frames", "image", "color"];
/// Names of folders of masks.
const FOLDERS: [&str; 8] = ["masks", "mask", "mattes", "alpha", "Masks", "Mask", "Mattes", "Alpha"];
/// Max number of different values of a mask of labels.
const MAX_LABELS: usize = 16;

/// Whether a file has the name of a mask: instant-ngp's, or `NAME_mask` or `NAME.mask` next to the image `NAME`.
fn is_mask_name(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let image = stem.strip_suffix("_mask").or_else(|| stem.strip_suffix(".mask"));
    stem.starts_with(DYNAMIC) || image.is_some_and(|image| find_image(&path.with_file_name(image)).is_some())
}

/// Lists the images in `folder` that are not masks, sorted by name.
pub(crate) fn list_photographs(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let mut images = list_images(folder)?;
    images.retain(|path| !is_mask_name(path));
    Ok(images)
}

/// Assigns masks to the frames of a capture that have none. A mask is in a folder of [`FOLDERS`] (or `masks_4` for `images_4`)
/// next to the folder of images or in it, under the image's name with another extension or with `.png` appended; or it is
/// there or next to the image as `NAME_mask.png` or `NAME.mask.png`; or it is instant-ngp's `dynamic_mask_NAME.png` next to
/// the image. Returns warnings: the number of masks, files in folders of masks that belong to no image, and folders of
/// which no file is used although they look like masks.
pub(super) fn find_masks(dir: &Path, format: Format, train: &mut [Frame], test: &mut [Frame]) -> Vec<String> {
    if matches!(format, Format::Dtu | Format::Zju) {
        return Vec::new();
    }
    let (mut found, mut folders) = (BTreeSet::<PathBuf>::new(), BTreeSet::<PathBuf>::new());
    for frame in train.iter_mut().chain(test.iter_mut()).filter(|frame| frame.mask.is_none()) {
        frame.mask = mask_of(dir, &frame.image);
        found.extend(frame.mask.iter().map(|(path, _)| path.clone()));
        folders.extend(frame.image.parent().map(Path::to_owned));
    }
    let images: BTreeSet<&Path> = train.iter().chain(test.iter()).map(|frame| frame.image.as_path()).collect();
    let counted = |first: &PathBuf| {
        let first = first.strip_prefix(dir).unwrap_or(first).display();
        format!("masks found for {} of {} images, such as {first}", found.len(), images.len())
    };
    let strays = folders.iter().filter_map(|folder| stray_masks(dir, folder));
    let masks = train.iter().chain(test.iter()).filter_map(|frame| Some(&*frame.mask.as_ref()?.0));
    let used: BTreeSet<&Path> = masks.chain(images.iter().copied()).collect();
    let places: BTreeSet<&Path> = folders.iter().flat_map(|folder| folder.ancestors().take(2)).collect();
    let below = places.into_iter().filter(|place| place.starts_with(dir)).flat_map(entries);
    let unused = below.filter_map(|path| unused_masks(dir, &path, &used));
    found.first().map(counted).into_iter().chain(strays).chain(unused).collect()
}

/// Returns a warning if `path` looks like a folder of masks and none of the `used` files are in it. Images in a folder of
/// [`FOLDERS`] are warned of by [`stray_masks`].
fn unused_masks(dir: &Path, path: &Path, used: &BTreeSet<&Path>) -> Option<String> {
    let (name, shown) = (file_name(path), path.strip_prefix(dir).unwrap_or(path).display());
    let is_like = ["mask", "matte", "alpha", "segment"].iter().any(|part| name.to_lowercase().contains(part));
    let is_stray = || FOLDERS.contains(&&*name) && list_images(path).is_ok_and(|images| !images.is_empty());
    let is_unused =
        is_like && !entries(path).is_empty() && !is_stray() && !used.iter().any(|file| file.starts_with(path));
    let advice = "is not used: masks are images in the folder `masks`, not .npy files";
    is_unused.then(|| format!("{shown} looks like a folder of masks and {advice}"))
}

/// Returns a warning if files in the folder of masks for the folder `images`, in the capture in `dir`, belong to no image.
pub(crate) fn stray_masks(dir: &Path, images: &Path) -> Option<String> {
    let images = list_images(images).ok()?;
    let places = mask_places(dir, images.first()?)?;
    let folder = places.first()?.parent()?;
    let masks: BTreeSet<PathBuf> = images.iter().filter_map(|image| Some(mask_of(dir, image)?.0)).collect();
    let files = list_images(folder).ok()?;
    let stray = file_name(files.iter().find(|file| !masks.contains(*file))?);
    let count = files.iter().filter(|file| !masks.contains(*file)).count();
    let (all, folder) = (files.len(), folder.strip_prefix(dir).unwrap_or(folder).display());
    let advice = "call the mask of a.jpg a.png, a.jpg.png or a_mask.png";
    Some(format!("{count} of {all} files in {folder} without an image, such as {stray}: {advice}"))
}

/// Returns the paths in folders of masks that correspond to the path of an image of the capture in `dir`.
fn mask_places(dir: &Path, image: &Path) -> Option<Vec<PathBuf>> {
    let is_image_folder = |folder: &&Path| {
        let name = file_name(folder);
        name.starts_with("images") || IMAGE_FOLDERS.contains(&&*name)
    };
    let folder = image.ancestors().skip(1).take_while(|folder| folder.starts_with(dir)).find(is_image_folder);
    let root = folder.map_or(Some(dir), Path::parent)?;
    let below = image.strip_prefix(folder.unwrap_or(dir)).ok()?;
    let reduced = folder.and_then(|folder| folder.file_name()?.to_str()?.strip_prefix("images"));
    let masks = root.join(format!("masks{}", reduced.unwrap_or_default())).join(below);
    let inside = Path::new(image.file_name()?);
    let places = [(root, below), (image.parent()?, inside)];
    let all = places.iter().flat_map(|(place, file)| FOLDERS.iter().map(move |masks| place.join(masks).join(file)));
    Some(std::iter::once(masks).chain(all).filter(|place| place.parent().is_some_and(Path::is_dir)).collect())
}

/// Returns the mask of an image of the capture in `dir`, if there is one.
pub(crate) fn mask_of(dir: &Path, image: &Path) -> Option<(PathBuf, MaskRole)> {
    let (name, stem) = (image.file_name()?.to_string_lossy(), image.file_stem()?.to_string_lossy());
    let marked = [format!("{stem}_mask.png"), format!("{stem}.mask.png"), format!("{name}.mask.png")];
    let alike = [name.to_string(), format!("{name}.png")];
    let find = |place: &Path, names: &[String]| {
        names.iter().find_map(|name| find_image(&place.with_file_name(name)).filter(|found| found != image))
    };
    let in_folder = |place: &PathBuf| find(place, &alike).or_else(|| find(place, &marked));
    if let Some(mask) = mask_places(dir, image)?.iter().find_map(in_folder).or_else(|| find(image, &marked)) {
        return Some((mask, MaskRole::Capture));
    }
    let dynamic = image.with_file_name(format!("{DYNAMIC}{stem}.png"));
    dynamic.is_file().then_some((dynamic, MaskRole::Dynamic))
}

/// Reads the mask of an `image` that is shown in `size`, see [`read_turned`]. The image's EXIF data turn a mask that has none
/// and fits the stored pixels alone; if it fits both, they turn it if cameras are for the stored pixels (`by_stored`).
pub(crate) fn read_mask(
    image: &Path,
    (path, role): &(PathBuf, MaskRole),
    size: (u32, u32),
    by_stored: bool,
) -> Result<Vec<bool>, SceneError> {
    let (own, turn) = (orientation(path), orientation(image));
    let fits = |size| stored_dimensions(path).map(|found| same_proportions(found, size));
    let is_turned = own == Orientation::NoTransforms
        && turn != Orientation::NoTransforms
        && fits(stored_dimensions(image)?)?
        && (by_stored || !fits(size)?);
    read_turned(path, *role, size, if is_turned { turn } else { own })
}

/// Reads the mask of an `image` for its stored pixels: one of their proportions as it is, another one turned back.
pub(crate) fn read_stored_mask(image: &Path, (path, role): &(PathBuf, MaskRole)) -> Result<Vec<bool>, SceneError> {
    let (own, turn, size) = (orientation(path), orientation(image), stored_dimensions(image)?);
    let turned_back = match turn {
        Orientation::NoTransforms => own,
        _ if own == turn || same_proportions(stored_dimensions(path)?, size) => Orientation::NoTransforms,
        Orientation::Rotate90 => Orientation::Rotate270,
        Orientation::Rotate270 => Orientation::Rotate90,
        // Mirroring and half turns are their own inverses.
        other => other,
    };
    read_turned(path, *role, size, turned_back)
}

/// Reads which pixels of an image of `size` count, row-major, from a mask that is turned by `turn`, a capture's also resized.
///
/// A pixel counts if it is not black. In a capture's mask of many values, or in a lossy format, it counts if it is brighter
/// than half the brightest pixel: this rejects JPEG noise in black areas and accepts masks of zeros and ones.
fn read_turned(path: &Path, role: MaskRole, size: (u32, u32), turn: Orientation) -> Result<Vec<bool>, SceneError> {
    let image = read_rgba_turned(path, turn)?;
    let found = (image.width, image.height);
    let is_capture = matches!(role, MaskRole::Capture | MaskRole::Dynamic);
    if found != size && !(is_capture && same_proportions(found, size)) {
        let expected = format!("a mask of {}×{} pixels like its image", size.0, size.1);
        return Err(SceneError::malformed(path, expected, format!("it has {}×{}", found.0, found.1)));
    }
    let brightness =
        |&[r, g, b, a]: &[f32; 4]| if a > 0.0 { r.max(g).max(b) * if is_capture { a } else { 1.0 } } else { 0.0 };
    let values = || image.pixels.iter().map(brightness);
    let mut labels = BTreeSet::new();
    let has_labels = values().all(|value| {
        labels.insert(value.to_bits());
        labels.len() <= MAX_LABELS
    });
    let extension = path.extension().unwrap_or_default();
    let is_lossless =
        ["png", "tif", "tiff", "bmp", "ppm", "tga"].iter().any(|known| extension.eq_ignore_ascii_case(known));
    let is_exact = !is_capture || has_labels && is_lossless;
    let threshold = if is_exact { 0.0 } else { 0.5 * values().fold(0.0, f32::max) };
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

/// Removes views without a valid pixel. Returns warnings of the pixels and views that are left out.
pub(super) fn check_valid(
    frames: &[&Frame],
    train: &mut Vec<View>,
    test: &mut Vec<View>,
) -> Result<Vec<String>, SceneError> {
    let is_blank = |view: &View| view.valid.as_ref().is_some_and(|valid| !valid.contains(&true));
    if let Some(frame) = frames.first().filter(|_| train.iter().all(is_blank)) {
        let file = frame.mask.as_ref().map_or(&frame.image, |(mask, _)| mask);
        let expected = "a mask that leaves pixels to train on (or `scene.masks = \"score\"`)";
        return Err(SceneError::malformed(file, expected, "all are black"));
    }
    let mut warnings = Vec::new();
    for (kind, used, views) in [("training", "trained on", &mut *train), ("test", "tested", &mut *test)] {
        let blank: Vec<String> = views.extract_if(.., |view| is_blank(view)).map(|view| view.name).collect();
        let names = blank.join(", ");
        if !blank.is_empty() {
            warnings.push(format!("not {used}, as masks leave no pixel: {kind} views {names}"));
        }
    }
    if test.is_empty() {
        return Err(SceneError::request("test", "a view whose mask is not black throughout", "none"));
    }
    let partial = train.iter().chain(test.iter()).filter(|view| view.valid.iter().any(|v| v.contains(&false)));
    let (bent, whole): (Vec<&View>, Vec<&View>) = partial.partition(|view| exceeds_lens(&view.camera));
    let masked = whole.into_iter().filter(|view| view.mask.is_some()).collect();
    let lens = "the lens cannot be inverted at the border (are its coefficients right?)";
    for (what, views) in [(lens, bent), ("masks leave out pixels", masked)] {
        let (count, all) = (views.len(), train.len() + test.len());
        let text = format!("in {count} of {all} views {what}: those pixels are neither trained on nor measured");
        warnings.extend((count > 0).then_some(text));
    }
    Ok(warnings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loaders::testing::{set_orientation, write_mask};
    use infonerf_scene::{Lens, Rgba8};

    #[test]
    fn masks_are_read_by_their_role() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        let write = |values: &[u8]| {
            let pixels = values.iter().map(|&v| [v, v, v, 255]).collect();
            Rgba8 { width: values.len() as u32, height: 1, pixels }.write_png(&path).unwrap();
        };
        let read_as = |role, size| read_turned(&path, role, size, Orientation::NoTransforms);
        let read = |role| read_as(role, (2, 1)).unwrap();
        // More values than labels have, as with noise in a black area.
        write(&(0..18).map(|i| 15 * i).collect::<Vec<u8>>());
        let bright: Vec<bool> = (0..18).map(|i| i > 8).collect();
        assert_eq!(read_as(MaskRole::Capture, (18, 1)).unwrap(), bright);
        // Labels of body parts; without a background; zeros and ones.
        for (values, counts) in [([0, 9], [false, true]), ([9, 255], [true; 2]), ([0, 1], [false, true])] {
            write(&values);
            assert_eq!(read(MaskRole::Counts), counts);
            assert_eq!(read(MaskRole::Capture), counts);
            assert_eq!(read(MaskRole::Dynamic), counts.map(|c| !c));
        }
        assert_eq!(read_as(MaskRole::Capture, (4, 2)).unwrap()[4..], [false, false, true, true]);
        assert!(read_as(MaskRole::Counts, (4, 2)).unwrap_err().to_string().contains("it has 2×1"));
        assert!(read_as(MaskRole::Capture, (1, 2)).unwrap_err().to_string().contains("it has 2×1"));
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
            ("images/g.png", "masks/g_mask.jpg", MaskRole::Capture),
            ("images/h.png", "masks/h.png.mask.png", MaskRole::Capture),
            ("train/i.jpg", "train/i.mask.png", MaskRole::Capture),
            ("photos/j.png", "Mask/j.png", MaskRole::Capture),
            ("frames/m.png", "Mask/m.png", MaskRole::Capture),
            ("input/v/k.png", "alpha/v/k.png", MaskRole::Capture),
            ("views/l.png", "views/mattes/l.png", MaskRole::Capture),
        ] {
            let (image, mask) = (dir.join(image), dir.join(mask));
            assert_eq!(mask_of(dir, &image), None);
            std::fs::create_dir_all(mask.parent().unwrap()).unwrap();
            std::fs::write(&mask, "").unwrap();
            assert_eq!(mask_of(dir, &image), Some((mask, role)));
        }
        std::fs::create_dir(dir.join("images")).unwrap();
        ["images/a.jpg", "train/i.jpg"].iter().for_each(|name| std::fs::write(dir.join(name), "").unwrap());
        assert!(is_mask_name(&dir.join("train/i.mask.png")) && !is_mask_name(&dir.join("train/k_mask.png")));
        let warning = stray_masks(dir, &dir.join("images")).unwrap();
        assert!(warning.starts_with("3 of 4 files in masks without an image, such as e.png: "), "{warning}");
        let (other, images) = (dir.join("segmentation"), BTreeSet::from([Path::new("e.png")]));
        std::fs::create_dir(&other).unwrap();
        assert_eq!(unused_masks(dir, &other, &images), None, "an empty folder");
        std::fs::write(other.join("e.npy"), "").unwrap();
        assert_eq!(unused_masks(dir, &other, &BTreeSet::from([&*other.join("e.npy")])), None);
        assert_eq!(unused_masks(dir, &dir.join("masks"), &images), None, "warned of by `stray_masks`");
        assert!(unused_masks(dir, &other, &images).unwrap().starts_with("segmentation looks like a folder of masks"));
    }

    /// Checks a mask whose left half is white, for an image that is stored lying.
    #[test]
    fn masks_of_stored_pixels_are_turned_with_their_images() {
        let guard = tempfile::tempdir().unwrap();
        let (photograph, path) = (guard.path().join("a.jpg"), guard.path().join("m.png"));
        write_mask(&path, (4, 2), |i| i % 4 < 2);
        let mask = (path, MaskRole::Capture);
        let bits = |counts: &[bool]| counts.iter().fold(0, |bits, &bit| 2 * bits + u32::from(bit));
        for (exif, size, by_stored, expected) in
            [(3, (4, 2), true, 0b0011_0011), (3, (4, 2), false, 0b1100_1100), (6, (2, 4), false, 0b1111_0000)]
        {
            image::RgbImage::new(4, 2).save(&photograph).unwrap();
            set_orientation(&photograph, exif);
            let counts = read_mask(&photograph, &mask, size, by_stored).unwrap();
            assert_eq!(bits(&counts), expected, "{exif}");
        }
        let shown = (guard.path().join("shown.png"), MaskRole::Capture);
        image::GrayImage::from_fn(2, 4, |_, y| image::Luma([255 * u8::from(y < 2)])).save(&shown.0).unwrap();
        for mask in [mask, shown] {
            assert_eq!(bits(&read_stored_mask(&photograph, &mask).unwrap()), 0b1100_1100, "{mask:?}");
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
