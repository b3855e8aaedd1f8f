//! Writing image files.

use std::path::Path;

use ::image::{ColorType, ImageError, ImageFormat};

use crate::SceneError;

/// Encodes 8-bit pixels as PNG.
pub(super) fn write_png(
    path: &Path,
    width: u32,
    height: u32,
    bytes: &[u8],
    color: ColorType,
) -> Result<(), SceneError> {
    let expected = usize::from(color.bytes_per_pixel()) * width as usize * height as usize;
    if width == 0 || height == 0 || bytes.len() != expected {
        let expected = format!("{expected} bytes for {width}×{height} pixels");
        return Err(SceneError::malformed(path, expected, format!("{} bytes", bytes.len())));
    }
    ::image::save_buffer_with_format(path, bytes, width, height, color, ImageFormat::Png).map_err(|error| match error {
        ImageError::IoError(source) => SceneError::io(path, source),
        other => SceneError::malformed(path, "an image that PNG can hold", other),
    })
}
