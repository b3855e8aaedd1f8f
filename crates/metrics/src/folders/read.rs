use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageReader};

use crate::error::MetricError;
use crate::mask::Mask;
use crate::picture::Picture;
use crate::protocol::Background;

const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Lists the images in `folder` by their names without extension.
pub(super) fn pictures(folder: &Path) -> Result<BTreeMap<String, PathBuf>, MetricError> {
    let of_folder = |error: std::io::Error| MetricError::file(folder, error);
    let mut pictures = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(of_folder)? {
        let path = entry.map_err(of_folder)?.path();
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let Some(name) = path.file_stem().map(|name| name.to_string_lossy().into_owned()) else { continue };
        if !extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str())) || name.starts_with('.') {
            continue;
        }
        if let Some(other) = pictures.insert(name, path.clone()) {
            let [first, second] = if other < path { [&other, &path] } else { [&path, &other] };
            let line = format!("{} and {} have the same name", first.display(), second.display());
            return Err(MetricError::Other(line));
        }
    }
    if pictures.is_empty() { Err(MetricError::file(folder, "no PNG or JPEG images in it")) } else { Ok(pictures) }
}

/// Reads the image at `path` and composites it on `background`: `α c + (1 − α) b`.
pub(super) fn picture(path: &Path, background: Background) -> Result<Picture, MetricError> {
    let image = decoded(path)?.into_rgba32f();
    let behind = background.color();
    let pixel = |[r, g, b, alpha]: [f32; 4]| {
        let color = [r, g, b];
        std::array::from_fn(|channel| alpha * color[channel] + (1.0 - alpha) * behind[channel])
    };
    let pixels = image.pixels().map(|rgba| pixel(rgba.0)).collect();
    Picture::new(pixels, image.width() as usize, image.height() as usize)
        .map_err(|error| MetricError::file(path, error))
}

/// Reads the mask at `path`: a pixel is inside unless it is black, so that images of class indices are masks, too.
pub(super) fn mask(path: &Path) -> Result<Mask, MetricError> {
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        return Err(MetricError::file(path, "a mask is a PNG: JPEG does not keep black exactly"));
    }
    let image = decoded(path)?.into_rgb16();
    let inside = image.pixels().map(|pixel| pixel.0 != [0; 3]).collect();
    Mask::new(inside, image.width() as usize, image.height() as usize)
}

fn decoded(path: &Path) -> Result<DynamicImage, MetricError> {
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let reader = reader.map_err(|error| MetricError::file(path, error))?;
    reader.decode().map_err(|error| MetricError::file(path, error))
}
