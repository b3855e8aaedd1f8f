//! Files of numbers: JSON, NumPy's arrays and archives, pickles; with limits on what is read.

pub(crate) mod json;
pub(crate) mod npy;
pub(crate) mod pickle;

use std::collections::BTreeSet;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use infonerf_scene::{Image, SceneError};

/// Plausible focal lengths and image sides, in pixels.
pub(crate) const PIXELS: RangeInclusive<f64> = 1e-3..=1e9;
/// Max absolute value of a coordinate, in scene units.
pub(crate) const MAX_COORDINATE: f64 = 1e11;

/// Reads a file. One of more than `limit` bytes is refused unread.
pub(crate) fn read_file(path: &Path, expected: &str, limit: u64) -> Result<Vec<u8>, SceneError> {
    if !path.is_file() {
        return Err(SceneError::NotFound { path: path.into(), expected: expected.into() });
    }
    let size = fs::metadata(path).map_err(|e| SceneError::io(path, e))?.len();
    if size > limit {
        return Err(SceneError::TooLarge { path: path.into(), what: "the size of the file in bytes", size, limit });
    }
    fs::read(path).map_err(|e| SceneError::io(path, e))
}

pub(crate) fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), SceneError> {
    fs::write(path, bytes).map_err(|e| SceneError::io(path, e))
}

/// Writes a mask of `size` = (width, height) as PNG, white where `is_white` is true of a pixel's row-major index.
pub(crate) fn write_mask(path: &Path, size: (u32, u32), is_white: impl Fn(u32) -> bool) -> Result<(), SceneError> {
    let (width, height) = size;
    let rgb = (0..width * height).map(|pixel| [f32::from(u8::from(is_white(pixel))); 3]).collect();
    Image { width, height, rgb, alpha: None }.write_png(path)
}

pub(crate) fn make_folder(path: &Path) -> Result<(), SceneError> {
    fs::create_dir_all(path).map_err(|e| SceneError::io(path, e))
}

/// Lists the files and folders in `folder`; none if it cannot be read.
pub(crate) fn entries(folder: &Path) -> BTreeSet<PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
}

pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
