//! From photographs to poses: by an installed COLMAP, or on our own.

mod colmap;
mod own;
mod refine;

pub use refine::with_refined_cameras;

use std::fs;
use std::path::{Path, PathBuf};

use infonerf_scene::SceneError;
use infonerf_scene::image::{heic_error, is_heic};

/// Below this many images no pose can be found.
const FEWEST: usize = 2;

/// Finds the poses of the photographs in `dir` (or in `dir/images`) and writes them to `dir/sparse`, where [`crate::load`]
/// finds them: with COLMAP if it is on PATH, and with `infonerf-sfm` if it is not, if it fails, or `without_colmap`. `progress` is given a
/// line for each step.
///
/// # Errors
/// There are fewer than two images; `dir/sparse` is there already; an image cannot be read; or the photographs do not
/// overlap enough for a reconstruction.
pub fn from_images(dir: &Path, without_colmap: bool, mut progress: impl FnMut(&str)) -> Result<(), SceneError> {
    let images = image_folder(dir)?;
    let sparse = dir.join("sparse");
    if sparse.exists() {
        let expected = "a folder without a reconstruction; remove this one to make another";
        return Err(SceneError::malformed(&sparse, expected, "it exists"));
    }
    if !without_colmap {
        match colmap::program(std::env::var_os("PATH")) {
            None => progress("colmap is not on PATH"),
            Some(program) => match colmap::pose(&program, dir, &images, &mut progress) {
                Ok(()) => return Ok(()),
                Err(error) => progress(&format!("colmap failed: {error}")),
            },
        }
    }
    own::pose(&images, &sparse, progress)
}

/// `dir/images` if it is there, else `dir`.
fn photograph_folder(dir: &Path) -> PathBuf {
    let below = dir.join("images");
    if below.is_dir() { below } else { dir.to_owned() }
}

/// What to do with the photographs in `dir`, if it has some, before they are a scene.
pub(crate) fn unposed(dir: &Path) -> Option<SceneError> {
    let folder = photograph_folder(dir);
    if crate::loaders::list_images(&folder).ok()?.is_empty() {
        return heic(&folder);
    }
    let reason = format!("these are photographs: `infonerf scene from-images {}` finds their poses", dir.display());
    Some(SceneError::malformed(dir, "a scene with poses", reason))
}

/// The fault of a folder whose photographs are HEICs.
fn heic(folder: &Path) -> Option<SceneError> {
    let found = fs::read_dir(folder).ok()?.find_map(|entry| entry.ok().filter(|entry| is_heic(&entry.path())))?;
    Some(heic_error(&found.path()))
}

/// The folder of photographs, with at least [`FEWEST`] images in it.
fn image_folder(dir: &Path) -> Result<PathBuf, SceneError> {
    let folder = photograph_folder(dir);
    if !folder.is_dir() {
        return Err(SceneError::NotFound { path: folder, expected: "a folder of photographs".into() });
    }
    let count = crate::loaders::list_images(&folder)?.len();
    if count < FEWEST {
        if let Some(error) = heic(&folder) {
            return Err(error);
        }
        return Err(SceneError::malformed(&folder, "at least two PNG or JPEG photographs", format!("it has {count}")));
    }
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_photographs_is_refused() {
        let guard = tempfile::tempdir().unwrap();
        let fault = |dir: &Path| from_images(dir, true, |_| {}).unwrap_err().to_string();
        let text = fault(guard.path());
        assert!(text.contains("at least two PNG or JPEG photographs: it has 0"), "{text}");
        fs::write(guard.path().join("IMG_1.HEIC"), "").unwrap();
        let text = fault(guard.path());
        assert!(text.contains("IMG_1.HEIC: expected PNG or JPEG: HEIC is not read; convert it"), "{text}");
        assert_eq!(unposed(guard.path()).unwrap().to_string(), text);
        assert!(fault(&guard.path().join("none")).contains("not found"));
    }
}
