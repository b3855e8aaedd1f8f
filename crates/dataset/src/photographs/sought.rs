//! List of the photographs that poses were sought for, which is kept with the poses.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use infonerf_scene::SceneError;

use super::photograph_folder;
use crate::capture::list_photographs;
use crate::files::file_name;

/// File next to the poses that lists the photographs, each in a line: its size in bytes and its name.
pub(super) const NAME: &str = "photographs.txt";

/// Returns a line of the list for each photograph in `dir`.
pub(super) fn lines(dir: &Path) -> Result<BTreeSet<String>, SceneError> {
    let line = |path: &PathBuf| {
        let size = fs::metadata(path).map_err(|e| SceneError::io(path, e))?.len();
        Ok(format!("{size} {}\n", file_name(path)))
    };
    list_photographs(&photograph_folder(dir))?.iter().map(line).collect()
}

/// Names the photographs in `dir` that were added, changed or removed since [`crate::from_images`] found their poses by
/// default settings; `None` if the poses in `dir/sparse` are of another origin.
///
/// # Errors
/// The photographs or their list cannot be read.
pub fn changed_photographs(dir: &Path) -> Result<Option<Vec<String>>, SceneError> {
    let list = dir.join("sparse").join(NAME);
    if !list.is_file() {
        return Ok(None);
    }
    let known = fs::read_to_string(&list).map_err(|e| SceneError::io(&list, e))?;
    let (known, now) = (known.split_inclusive('\n').map(str::to_owned).collect::<BTreeSet<_>>(), lines(dir)?);
    let differing = known.symmetric_difference(&now).filter_map(|line| line.trim_end().split_once(' '));
    let names: BTreeSet<String> = differing.map(|(_, name)| name.to_owned()).collect();
    Ok(Some(names.into_iter().collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photographs_that_have_changed_are_named() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path();
        let photograph = |name: &str, text: &str| fs::write(dir.join(name), text).unwrap();
        ["a.png", "b b.png", "c.png"].iter().for_each(|name| photograph(name, "first"));
        fs::create_dir(dir.join("sparse")).unwrap();
        assert_eq!(changed_photographs(dir).unwrap(), None);
        fs::write(dir.join("sparse").join(NAME), String::from_iter(lines(dir).unwrap())).unwrap();
        assert_eq!(changed_photographs(dir).unwrap(), Some(Vec::new()));
        photograph("b b.png", "retaken");
        photograph("d.png", "first");
        fs::remove_file(dir.join("c.png")).unwrap();
        assert_eq!(changed_photographs(dir).unwrap().unwrap(), ["b b.png", "c.png", "d.png"]);
    }
}
