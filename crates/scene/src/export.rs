//! Writing a procedural scene as a folder in Blender's format.
use std::path::Path;
use crate::SceneError;
/// TODO
///
/// # Errors
/// TODO
pub fn export(_name: &str, _size: u32, _dir: &Path) -> Result<(), SceneError> { Ok(()) }
