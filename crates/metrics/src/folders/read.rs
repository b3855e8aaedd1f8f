use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use infonerf_scene::SceneError;
use infonerf_scene::image::{Image, list_images, read_rgba};

use crate::error::MetricError;
use crate::mask::Mask;
use crate::picture::Picture;
use crate::protocol::Background;

/// Extensions of the formats that are read, in lower case.
const EXTENSIONS: [&str; 9] = ["png", "jpg", "jpeg", "jpe", "jfif", "webp", "tif", "tiff", "bmp"];
/// Extensions of formats that keep black exactly.
const LOSSLESS: [&str; 4] = ["png", "tif", "tiff", "bmp"];

/// Lists the images in `folder` by their names without extension.
pub(super) fn pictures(folder: &Path) -> Result<BTreeMap<String, PathBuf>, MetricError> {
    let mut pictures = BTreeMap::new();
    for path in list_images(folder).map_err(unreadable)?.into_iter().filter(|path| has_extension(path, &EXTENSIONS)) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(other) = pictures.insert(name, path.clone()) {
            let line = format!("{} and {} have the same name", other.display(), path.display());
            return Err(MetricError::Other(line));
        }
    }
    if pictures.is_empty() {
        return Err(MetricError::file(folder, "no PNG, JPEG, WebP, TIFF or BMP images in it"));
    }
    Ok(pictures)
}

/// Whether the file's name has one of `extensions`, in any case.
fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|own| extensions.iter().any(|known| own.eq_ignore_ascii_case(known)))
}

/// Reads the image at `path`, turned as its EXIF data state, and composites it on `background`: `α c + (1 − α) b`.
pub(super) fn picture(path: &Path, background: Background) -> Result<Picture, MetricError> {
    let Image { width, height, rgb, .. } = Image::read(path, background.color()).map_err(unreadable)?;
    Picture::new(rgb, width as usize, height as usize).map_err(|error| MetricError::file(path, error))
}

/// Reads the mask at `path`, turned as its EXIF data state. A pixel is inside unless it is black or transparent, so that
/// images of class indices are masks, too.
pub(super) fn mask(path: &Path) -> Result<Mask, MetricError> {
    if !has_extension(path, &LOSSLESS) {
        return Err(MetricError::file(path, "a mask is a PNG, TIFF or BMP: JPEG and WebP need not keep black exactly"));
    }
    let image = read_rgba(path).map_err(unreadable)?;
    let inside = image.pixels.iter().map(|pixel| pixel[..3] != [0.0; 3] && pixel[3] > 0.0).collect();
    Mask::new(inside, image.width as usize, image.height as usize)
}

fn unreadable(error: SceneError) -> MetricError {
    MetricError::Other(error.to_string())
}
