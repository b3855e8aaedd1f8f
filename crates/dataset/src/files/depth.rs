//! Exact depth next to the images, an extension of the Blender format.

use std::path::Path;

use infonerf_scene::SceneError;

use super::npy;

/// Reads distances along the unit pixel rays, `[height, width]`; +∞ where a ray hits nothing.
pub(crate) fn read_depth(path: &Path, width: u32, height: u32) -> Result<Vec<f32>, SceneError> {
    let expected = format!("f32 ray distances of shape [{height}, {width}]");
    let array = npy::read(path, &expected)?;
    if array.shape != [u64::from(height), u64::from(width)] {
        return Err(SceneError::malformed(path, expected, format!("shape {:?}", array.shape)));
    }
    if let Some(bad) = array.values.iter().find(|v| v.is_nan() || **v < 0.0) {
        return Err(SceneError::malformed(path, expected, format!("the distance {bad}")));
    }
    Ok(array.values.into_iter().map(|v| v as f32).collect())
}

/// Writes what [`read_depth`] reads.
pub(crate) fn write_depth(path: &Path, width: u32, height: u32, depth: &[f32]) -> Result<(), SceneError> {
    npy::write(path, &[u64::from(height), u64::from(width)], depth)
}
