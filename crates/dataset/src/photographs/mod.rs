//! Poses of photographs: found by `infonerf-sfm` or an installed COLMAP.

mod colmap;
mod own;
mod sought;
mod video;

pub(crate) use own::MARK as OWN_POSES;
pub use sought::changed_photographs;
pub use video::{video_folder, video_frames};

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use infonerf_scene::SceneError;
use infonerf_scene::image::{find_image, is_image_name, list_images, unread_format};

use crate::capture::{join_names, list_photographs, stray_masks};
use crate::colmap::{ColmapImage, Reconstruction};
use crate::files::{entries, file_name, write_file};

const OVERLAPPING: &str = "photographs that overlap enough to find their poses";
/// Min number of photographs with a pose, and of those from which poses can be found.
const MIN_IMAGES: usize = 2;

/// Folder in the scene's folder in which poses are made. It exists afterwards only if an attempt was interrupted.
const WORK: &str = "poses.partial";

/// Program that finds poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseSolver {
    /// `infonerf-sfm`. If it leaves photographs out and COLMAP is installed, COLMAP as well, and the better result of the two.
    #[default]
    Best,
    /// `infonerf-sfm` alone.
    Own,
    /// COLMAP alone.
    Colmap,
}

/// Way of finding the poses of photographs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseSearch {
    /// Program that is used.
    pub solver: PoseSolver,
    /// Focal length divided by the longer image side; else that of EXIF data, else a guess. COLMAP does not use it.
    pub focal: Option<f64>,
}

/// Finds the poses of the photographs in `dir` (or in `dir/images`) and writes them to `dir/sparse`, where [`crate::load`]
/// finds them. `progress` receives a line for each step, for each photograph, and for the choice between two solvers.
/// Replaces poses that it found by default settings if [`changed_photographs`] names any.
///
/// # Errors
/// There are fewer than two images; other poses are in `dir/sparse`; `dir` cannot be written; an image cannot be read; or
/// the photographs do not overlap enough for a reconstruction, or show no depth.
pub fn from_images(dir: &Path, search: &PoseSearch, mut progress: impl FnMut(&str)) -> Result<(), SceneError> {
    let images = image_folder(dir)?;
    let sparse = dir.join("sparse");
    let changed = changed_photographs(dir)?.unwrap_or_default();
    if !changed.is_empty() {
        if let Some(foreign) = foreign_file(&sparse) {
            let expected = "only poses that were found here, as finding them again replaces the folder";
            return Err(SceneError::malformed(&sparse, expected, format!("{} is not of them", foreign.display())));
        }
        progress(&format!("finding poses again: photographs were added, changed or removed: {}", changed.join(", ")));
    } else if sparse.exists() {
        let expected = "a folder without a reconstruction; remove this one to make another";
        return Err(SceneError::malformed(&sparse, expected, "it exists"));
    }
    let warnings = [unread_warning(&images), same_name_warning(&images)];
    warnings.iter().flatten().for_each(|warning| progress(warning));
    let work = dir.join(WORK);
    fs::create_dir_all(&work).and_then(|()| fs::remove_dir_all(&work)).map_err(|e| {
        let reason = format!("{e}; copy the photographs to one that can be");
        SceneError::malformed(dir, "a folder that can be written", reason)
    })?;
    let (sought, poses) = (sought::lines(dir)?, work.join("found"));
    let found = find_poses(dir, search, (&work, &poses, &images), &mut progress);
    // If poses are found, the scene has this warning.
    let found = found.inspect_err(|_| stray_masks(dir, &images).iter().for_each(|warning| progress(warning)));
    let moved = found.and_then(|()| {
        // Settings of the user's own are not known to a later search.
        if *search == PoseSearch::default() {
            write_file(&poses.join(sought::NAME), String::from_iter(sought))?;
        }
        let removed = if sparse.exists() { fs::remove_dir_all(&sparse) } else { Ok(()) };
        removed.and_then(|()| fs::rename(&poses, &sparse)).map_err(|e| SceneError::io(&sparse, e))
    });
    // The next attempt removes what cannot be removed now.
    let _ = fs::remove_dir_all(&work);
    moved
}

/// Finds poses by the solver of `search` with intermediate files in the folder `work`, and writes them to the folder `poses`.
fn find_poses(
    dir: &Path,
    search: &PoseSearch,
    (work, poses, images): (&Path, &Path, &Path),
    progress: &mut impl FnMut(&str),
) -> Result<(), SceneError> {
    let colmap = program(colmap::PROGRAM, std::env::var_os("PATH"));
    if search.solver == PoseSolver::Colmap {
        if search.focal.is_some() {
            let expected = "no focal length next to the solver colmap";
            return Err(SceneError::malformed(dir, expected, "colmap does not use it"));
        }
        let missing = || SceneError::malformed(dir, "the colmap program to find the poses", "colmap is not on PATH");
        let found = colmap::find(&colmap.ok_or_else(missing)?, work, images, progress)?;
        return keep_colmap(&found, (work, poses, images), progress);
    }
    let own = own::find(dir, images, search.focal, &mut *progress);
    // COLMAP cannot read more photographs, and invents a baseline where there is none.
    let is_final = own.as_ref().map_or_else(|not_found| !not_found.too_few_overlap, |found| found.left_out == 0);
    let own = own.map_err(|not_found| not_found.error);
    match colmap.filter(|_| search.solver == PoseSolver::Best && !is_final) {
        Some(colmap) => better(own, &colmap, (work, poses, images), progress),
        None => own?.write(poses),
    }
}

/// Returns a file or folder in the folder `sparse` of a scene that finding poses has not written.
fn foreign_file(sparse: &Path) -> Option<PathBuf> {
    const MODEL: [&str; 7] = ["cameras", "images", "points3D", "frames", "rigs", "project", "infonerf"];
    let is_model = |path: &PathBuf| path.file_stem().is_some_and(|stem| MODEL.iter().any(|&name| stem == name));
    entries(sparse).into_iter().find_map(|path| match file_name(&path) {
        name if name.parse::<u32>().is_ok() => entries(&path).into_iter().find(|file| !is_model(file)),
        name => (name != sought::NAME).then_some(path),
    })
}

/// Runs COLMAP as well, and writes the poses of the solver that places more photographs, or as many with smaller residuals.
fn better(
    own: Result<own::OwnPoses, SceneError>,
    colmap: &Path,
    (work, poses, images): (&Path, &Path, &Path),
    progress: &mut impl FnMut(&str),
) -> Result<(), SceneError> {
    progress("not all photographs are placed: colmap tries as well");
    let found = match colmap::find(colmap, work, images, progress) {
        Ok(found) => found,
        Err(error) => {
            progress(&format!("colmap failed: {error}"));
            return own?.write(poses);
        }
    };
    let names: Vec<String> = list_photographs(images)?.iter().map(|path| file_name(path)).collect();
    let count = names.len();
    let ours = own.as_ref().map_or((0, f64::INFINITY), |own| quality(&own.model, &names));
    let theirs = quality(&found, &names);
    let is_better = exceeds(theirs, ours);
    let describe = |(placed, residual): (usize, f64)| match residual {
        f64::INFINITY => format!("{placed} of {count} photographs"),
        _ => format!("{placed} of {count} photographs with a residual of {residual:.2} pixels"),
    };
    let kept = if is_better { "colmap's" } else { "this program's" };
    let (ours, theirs) = (describe(ours), describe(theirs));
    progress(&format!("{kept} poses are kept: colmap placed {theirs}, this program {ours}"));
    if is_better { keep_colmap(&found, (work, poses, images), progress) } else { own?.write(poses) }
}

/// Whether the reconstruction with the first number of photographs and residual is better than that with the second ones.
fn exceeds(first: (usize, f64), second: (usize, f64)) -> bool {
    (first.0, -first.1) > (second.0, -second.1)
}

/// Moves the reconstruction that COLMAP has left in `work` to `poses`, and names the photographs that it left out.
fn keep_colmap(
    found: &Reconstruction,
    (work, poses, images): (&Path, &Path, &Path),
    progress: &mut impl FnMut(&str),
) -> Result<(), SceneError> {
    for name in list_photographs(images)?.iter().map(|path| file_name(path)) {
        if !found.images.iter().any(|image| image.name == name) {
            progress(&format!("{name}: not placed: colmap did not register it"));
        }
    }
    fs::rename(work.join("sparse"), poses).map_err(|e| SceneError::io(poses, e))
}

/// Returns how many photographs of `names` are placed, and their median reprojection error in pixels, infinite without points.
fn quality(found: &Reconstruction, names: &[String]) -> (usize, f64) {
    let placed: Vec<&ColmapImage> = found.images.iter().filter(|image| names.contains(&image.name)).collect();
    let mut residuals = Vec::new();
    for image in &placed {
        let Some(camera) = found.camera(image) else { continue };
        residuals.extend(image.observations.iter().filter_map(|(pixel, id)| {
            Some(camera.project_f64(*found.points.get(id)?).map_or(f64::INFINITY, |seen| seen.distance(*pixel)))
        }));
    }
    residuals.sort_by(f64::total_cmp);
    (placed.len(), residuals.get(residuals.len() / 2).copied().unwrap_or(f64::INFINITY))
}

/// Returns the program `name` in the first folder of `path` that has it.
fn program(name: &str, path: Option<OsString>) -> Option<PathBuf> {
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&path?).map(|folder| folder.join(&name)).find(|p| p.is_file())
}

/// Returns `dir/images` if it is there, unless photographs are in `dir` and none are in `dir/images`.
pub fn photograph_folder(dir: &Path) -> PathBuf {
    let below = dir.join("images");
    let is_photograph = |path: &PathBuf| is_image_name(path) || unread_format(path).is_some();
    let has_any = |folder: &Path| entries(folder).iter().any(is_photograph);
    if below.is_dir() && (has_any(&below) || !has_any(dir)) { below } else { dir.to_owned() }
}

/// Returns advice on the video `path`; `None` for a file of another kind.
pub(crate) fn video_advice(path: &Path) -> Option<String> {
    const VIDEOS: [&str; 6] = ["mp4", "mov", "m4v", "avi", "mkv", "webm"];
    let is_video = path.extension().is_some_and(|e| VIDEOS.iter().any(|known| e.eq_ignore_ascii_case(known)));
    let quoted = shlex::try_quote(path.to_str()?).ok()?.into_owned();
    is_video.then(|| format!("`infonerf capture {quoted}` takes frames of the video and learns the scene"))
}

/// Returns the error about a folder whose photographs are in a format that is not read, or which has a video instead.
fn no_photographs(folder: &Path) -> Option<SceneError> {
    let unread = list_unread(folder).iter().find_map(|path| unread_format(path));
    let video = || entries(folder).iter().find_map(|path| video_advice(path));
    unread.or_else(|| Some(SceneError::malformed(folder, "at least two photographs", video()?)))
}

/// Names a file in `dir` that may be another program's export of poses, and the converter of nerfstudio that reads it.
fn exported_poses(dir: &Path) -> Option<String> {
    let (path, program) = entries(dir).into_iter().find_map(|path| match path.extension()?.to_str()? {
        "xml" => Some((path, "metashape")),
        "csv" => Some((path, "realitycapture")),
        _ => None,
    })?;
    Some(format!("; if {} has poses, nerfstudio's `ns-process-data {program}` converts them", file_name(&path)))
}

/// Returns an error with advice on finding poses, if `dir` has photographs.
pub(crate) fn missing_poses_error(dir: &Path) -> Option<SceneError> {
    let folder = photograph_folder(dir);
    if list_images(&folder).ok()?.is_empty() {
        return no_photographs(&folder);
    }
    let path = dir.display().to_string();
    let advice = format!("`infonerf capture {}` finds their poses and learns the scene", shlex::try_quote(&path).ok()?);
    let exported = exported_poses(dir).unwrap_or_default();
    Some(SceneError::malformed(dir, "a scene with poses", format!("these are photographs: {advice}{exported}")))
}

/// Lists the photographs in `folder` of formats that are not read, without those that have an image of their name beside them.
fn list_unread(folder: &Path) -> Vec<PathBuf> {
    let is_hidden = |path: &Path| file_name(path).starts_with('.');
    let is_alone = |path: &Path| find_image(&path.with_extension("jpg")).is_none();
    let is_unread = |path: &PathBuf| unread_format(path).is_some() && !is_hidden(path) && is_alone(path);
    entries(folder).into_iter().filter(is_unread).collect()
}

/// Returns a warning that counts the photographs in `folder` whose formats are not read.
fn unread_warning(folder: &Path) -> Option<String> {
    let unread = list_unread(folder);
    let kinds = unread.iter().filter_map(|path| Some(format!("*.{}", path.extension()?.to_str()?)));
    let kinds = Vec::from_iter(kinds.collect::<BTreeSet<_>>()).join(" ");
    let convert = format!("convert them, such as with ImageMagick: `magick mogrify -format jpg {kinds}`");
    (!unread.is_empty()).then(|| format!("files in formats that are not read: {}; {convert}", unread.len()))
}

/// Returns a warning that names the photographs in `folder` whose names differ in the extension alone.
fn same_name_warning(folder: &Path) -> Option<String> {
    let all = list_photographs(folder).ok()?;
    let is_alike = |path: &&PathBuf| all.iter().any(|other| other != *path && other.file_stem() == path.file_stem());
    let names: Vec<String> = all.iter().filter(is_alike).map(|path| file_name(path)).collect();
    let listed = join_names(names.iter().map(String::as_str));
    (!names.is_empty()).then(|| format!("photographs with one name: {listed}; if two show one picture, remove one"))
}

/// Returns the folder of photographs, or an error if it has fewer than [`MIN_IMAGES`] images.
fn image_folder(dir: &Path) -> Result<PathBuf, SceneError> {
    let folder = photograph_folder(dir);
    if !folder.is_dir() {
        return Err(SceneError::NotFound { path: folder, expected: "a folder of photographs".into() });
    }
    let count = list_photographs(&folder)?.len();
    if count < MIN_IMAGES {
        let mut below = entries(&folder);
        below.retain(|path| list_images(path).is_ok_and(|images| !images.is_empty()));
        let names = below.iter().map(|path| file_name(path)).collect::<Vec<_>>().join(", ");
        let names = if names.is_empty() { names } else { format!("; subfolders with images: {names}") };
        let few = || SceneError::malformed(&folder, "at least two photographs", format!("it has {count}{names}"));
        return Err(no_photographs(&folder).unwrap_or_else(few));
    }
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_the_user_beside_poses_are_kept() {
        let guard = tempfile::tempdir().unwrap();
        let (dir, sparse) = (guard.path(), guard.path().join("sparse"));
        fs::create_dir_all(sparse.join("0")).unwrap();
        let files = ["a.png", "b.png", "sparse/photographs.txt", "sparse/0/images.bin", "sparse/0/notes.txt"];
        fs::write(sparse.join("0").join(OWN_POSES), "").unwrap();
        files.iter().for_each(|name| fs::write(dir.join(name), "").unwrap());
        let fault = || from_images(dir, &PoseSearch::default(), |_| {}).unwrap_err().to_string();
        assert!(fault().contains("notes.txt is not of them"));
        fs::rename(sparse.join("0/notes.txt"), sparse.join("mine")).unwrap();
        assert!(fault().contains("mine is not of them"));
        fs::remove_file(sparse.join("mine")).unwrap();
        assert!(fault().contains("a.png: expected a complete"), "{}", fault());
    }

    #[test]
    fn more_photographs_are_better_and_of_as_many_smaller_residuals() {
        let others = [(9, 0.1), (10, 0.6), (10, 0.5), (10, 0.4), (11, 0.9)];
        assert_eq!(others.map(|other| exceeds(other, (10, 0.5))), [false, false, false, true, true]);
    }

    #[test]
    fn a_folder_without_photographs_is_refused() {
        let guard = tempfile::tempdir().unwrap();
        let search = PoseSearch { solver: PoseSolver::Own, focal: None };
        let fault = |dir: &Path| from_images(dir, &search, |_| {}).unwrap_err().to_string();
        let text = fault(guard.path());
        assert!(text.ends_with("at least two photographs: it has 0"), "{text}");
        fs::write(guard.path().join("IMG_1.HEIC"), "").unwrap();
        let text = fault(guard.path());
        let unread = "IMG_1.HEIC: expected PNG, JPEG, WebP, TIFF, BMP, PPM or TGA: HEIC is not read; convert it";
        assert!(text.contains(unread), "{text}");
        assert_eq!(missing_poses_error(guard.path()).unwrap().to_string(), text);
        let shots = guard.path().join("my shots");
        fs::create_dir(&shots).unwrap();
        ["a.png", "b.png"].iter().for_each(|name| fs::write(shots.join(name), "").unwrap());
        let text = missing_poses_error(&shots).unwrap().to_string();
        assert!(text.contains(&format!("`infonerf capture '{}'` finds", shots.display())), "{text}");
        fs::write(shots.join("cameras.xml"), "").unwrap();
        let text = missing_poses_error(&shots).unwrap().to_string();
        assert!(text.ends_with("; if cameras.xml has poses, nerfstudio's `ns-process-data metashape` converts them"));
        fs::remove_file(guard.path().join("IMG_1.HEIC")).unwrap();
        assert!(fault(guard.path()).ends_with("at least two photographs: it has 0; subfolders with images: my shots"));
        fs::write(guard.path().join("walk.MP4"), "").unwrap();
        assert!(missing_poses_error(guard.path()).unwrap().to_string().contains("walk.MP4` takes frames of the video"));
        ["c.HEIC", "d.HEIC", "e.cr2", "a.DNG"].iter().for_each(|name| fs::write(shots.join(name), "").unwrap());
        let warning = unread_warning(&shots).unwrap();
        assert!(warning.starts_with("files in formats that are not read: 3; "), "{warning}");
        assert!(warning.ends_with(" *.HEIC *.cr2`"), "{warning}");
        // An empty folder hides no photographs.
        fs::create_dir(shots.join("images")).unwrap();
        [WORK, "a.b.png", "a.JPG"].iter().for_each(|name| fs::write(shots.join(name), "").unwrap());
        let mut lines = Vec::new();
        let text = from_images(&shots, &search, |line| lines.push(line.to_owned())).unwrap_err().to_string();
        assert!(text.contains("my shots: expected a folder that can be written: "));
        assert!(lines[0] == warning && lines[1].starts_with("photographs with one name: a.JPG, a.png; "), "{lines:?}");
        assert!(fault(&guard.path().join("none")).contains("not found"));
    }
}
