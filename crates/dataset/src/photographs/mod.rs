//! Poses of photographs: found by an installed COLMAP or by `infonerf-sfm`.

mod colmap;
mod own;
mod video;

pub use video::{video_folder, video_frames};

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use infonerf_scene::SceneError;
use infonerf_scene::image::{list_images, unread_format};

/// Below this many images no pose can be found.
const MIN_IMAGES: usize = 2;

/// Way of finding the poses of photographs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseSearch {
    /// Whether an installed COLMAP is passed over.
    pub without_colmap: bool,
    /// Focal length in image widths (of the longer side); else what EXIF data state, else a guess.
    pub focal: Option<f64>,
}

/// Finds the poses of the photographs in `dir` (or in `dir/images`) and writes them to `dir/sparse`, where [`crate::load`]
/// finds them: with COLMAP if it is on PATH, and with `infonerf-sfm` if it is not, if it fails, or if `search` asks for it.
/// `progress` receives a line for each step.
///
/// # Errors
/// There are fewer than two images; `dir/sparse` is there already; an image cannot be read; or the photographs do not
/// overlap enough for a reconstruction, or show no depth.
pub fn from_images(dir: &Path, search: &PoseSearch, mut progress: impl FnMut(&str)) -> Result<(), SceneError> {
    let images = image_folder(dir)?;
    let sparse = dir.join("sparse");
    if sparse.exists() {
        let expected = "a folder without a reconstruction; remove this one to make another";
        return Err(SceneError::malformed(&sparse, expected, "it exists"));
    }
    if !search.without_colmap {
        match program(colmap::PROGRAM, std::env::var_os("PATH")) {
            None => progress("colmap is not on PATH"),
            Some(program) => match colmap::pose(&program, dir, &images, &mut progress) {
                Ok(()) => return Ok(()),
                Err(error) => progress(&format!("colmap failed: {error}")),
            },
        }
    }
    own::pose(&images, &sparse, search.focal, progress)
}

/// Returns the program `name` in the first folder of `path` that has it.
fn program(name: &str, path: Option<OsString>) -> Option<PathBuf> {
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&path?).map(|folder| folder.join(&name)).find(|p| p.is_file())
}

/// Returns `dir/images` if it is there, else `dir`.
fn photograph_folder(dir: &Path) -> PathBuf {
    let below = dir.join("images");
    if below.is_dir() { below } else { dir.to_owned() }
}

/// Returns the error that names the way from the photographs in `dir`, if it has some, to a scene.
pub(crate) fn unposed(dir: &Path) -> Option<SceneError> {
    let folder = photograph_folder(dir);
    if list_images(&folder).ok()?.is_empty() {
        return first_unread(&folder);
    }
    let reason = format!("these are photographs: `infonerf scene from-images {}` finds their poses", dir.display());
    Some(SceneError::malformed(dir, "a scene with poses", reason))
}

/// Returns the error about a folder whose photographs are in a format that is not read.
fn first_unread(folder: &Path) -> Option<SceneError> {
    fs::read_dir(folder).ok()?.find_map(|entry| unread_format(&entry.ok()?.path()))
}

/// Returns the folder of photographs, with at least [`MIN_IMAGES`] images in it.
fn image_folder(dir: &Path) -> Result<PathBuf, SceneError> {
    let folder = photograph_folder(dir);
    if !folder.is_dir() {
        return Err(SceneError::NotFound { path: folder, expected: "a folder of photographs".into() });
    }
    let count = list_images(&folder)?.len();
    if count < MIN_IMAGES {
        if let Some(error) = first_unread(&folder) {
            return Err(error);
        }
        return Err(SceneError::malformed(&folder, "at least two photographs", format!("it has {count}")));
    }
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_photographs_is_refused() {
        let guard = tempfile::tempdir().unwrap();
        let search = PoseSearch { without_colmap: true, focal: None };
        let fault = |dir: &Path| from_images(dir, &search, |_| {}).unwrap_err().to_string();
        let text = fault(guard.path());
        assert!(text.contains("at least two photographs: it has 0"), "{text}");
        fs::write(guard.path().join("IMG_1.HEIC"), "").unwrap();
        let text = fault(guard.path());
        assert!(text.contains("IMG_1.HEIC: expected PNG or JPEG: HEIC is not read; convert it"), "{text}");
        assert_eq!(unposed(guard.path()).unwrap().to_string(), text);
        assert!(fault(&guard.path().join("none")).contains("not found"));
    }
}
