use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageDecoder, ImageReader, ImageResult, Rgba};

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
    let of_folder = |error: std::io::Error| MetricError::file(folder, error);
    let mut pictures = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(of_folder)? {
        let path = entry.map_err(of_folder)?.path();
        let Some(name) = path.file_stem().map(|name| name.to_string_lossy().into_owned()) else { continue };
        if !has_extension(&path, &EXTENSIONS) || name.starts_with('.') {
            continue;
        }
        if let Some(other) = pictures.insert(name, path.clone()) {
            let [first, second] = if other < path { [&other, &path] } else { [&path, &other] };
            let line = format!("{} and {} have the same name", first.display(), second.display());
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

/// Reads the image at `path` and composites it on `background`: `α c + (1 − α) b`.
pub(super) fn picture(path: &Path, background: Background) -> Result<Picture, MetricError> {
    let image = decoded(path)?.into_rgba32f();
    let behind = background.color();
    let pixel = |Rgba(rgba): &Rgba<f32>| [0, 1, 2].map(|c| rgba[3] * rgba[c] + (1.0 - rgba[3]) * behind[c]);
    let pixels = image.pixels().map(pixel).collect();
    Picture::new(pixels, image.width() as usize, image.height() as usize)
        .map_err(|error| MetricError::file(path, error))
}

/// Reads the mask at `path`: a pixel is inside unless it is black or transparent, so that images of class indices are masks, too.
pub(super) fn mask(path: &Path) -> Result<Mask, MetricError> {
    if !has_extension(path, &LOSSLESS) {
        return Err(MetricError::file(path, "a mask is a PNG, TIFF or BMP: JPEG and WebP need not keep black exactly"));
    }
    let image = decoded(path)?.into_rgba16();
    let inside = image.pixels().map(|pixel| pixel.0[..3] != [0; 3] && pixel.0[3] > 0).collect();
    Mask::new(inside, image.width() as usize, image.height() as usize)
}

/// Reads the image at `path`, turned as its EXIF orientation demands.
fn decoded(path: &Path) -> Result<DynamicImage, MetricError> {
    let decode = || -> ImageResult<DynamicImage> {
        let mut decoder = ImageReader::open(path)?.with_guessed_format()?.into_decoder()?;
        let orientation = decoder.orientation()?;
        let mut image = DynamicImage::from_decoder(decoder)?;
        image.apply_orientation(orientation);
        Ok(image)
    };
    decode().map_err(|error| MetricError::file(path, error))
}
