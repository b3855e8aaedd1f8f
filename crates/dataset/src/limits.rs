//! Limits on what is read.

use std::fs;
use std::path::Path;

use infonerf_scene::SceneError;

/// The greatest coordinate of anything, scene units: beyond it `f32` has no precision left for a scene.
pub(crate) const FARTHEST: f64 = 1e9;

/// The contents of a file. One of more than `limit` bytes is refused without being read.
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
