//! The scenes and seeds that an experiment runs on.

use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use infonerf_dataset::SceneSource;
use infonerf_procedural as procedural;

/// Maximum number of seeds in one range.
const MAX_SEEDS: u64 = 10_000;
/// Maximum length of a folder's name in bytes that file systems allow.
const MAX_BYTES: usize = 255;

/// Parses a seed, or a range of seeds such as `0..4`, both ends included.
///
/// # Errors
/// If the text is neither; the message says what was expected.
pub fn parse_seeds(text: &str) -> Result<RangeInclusive<u64>, String> {
    let fault = || format!("expected a seed such as 3, or seeds such as 0..4, found `{text}`");
    let number = |text: &str| text.trim().parse::<u64>().map_err(|_| fault());
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let (first, last) = (number(first)?, number(last)?);
    if first <= last && last - first < MAX_SEEDS { Ok(first..=last) } else { Err(fault()) }
}

/// Returns an error for a name that some file system does not allow for a folder: it is empty, a path, `.` or `..`, has
/// control characters or one of `<>:"|?*`, ends with a dot or space, or is too long.
pub fn check_name(what: &str, name: &str) -> Result<()> {
    let reserved = |c: &char| c.is_control() || r#"/\<>:"|?*"#.contains(*c);
    let fault = match name {
        "" => "it is empty".to_owned(),
        "." | ".." => "it means another folder".to_owned(),
        _ => match name.chars().find(reserved) {
            Some(c) => format!("it holds {c:?}"),
            None if name.ends_with(['.', ' ']) => "it ends with a dot or a space".to_owned(),
            None if name.len() > MAX_BYTES => format!("it has {} bytes, more than {MAX_BYTES}", name.len()),
            None => return Ok(()),
        },
    };
    bail!("{what} {name:?}: expected a name that a folder can have on every system: {fault}")
}

/// Finds the scenes called `names`, by default all: in the folder `data` or, without one, among the built-in scenes. Errors name
/// the `place` of the names: an option, or a file with its key.
pub(crate) fn find_scenes(
    data: Option<&Path>,
    names: Option<Vec<String>>,
    place: &str,
) -> Result<Vec<(String, SceneSource)>> {
    let built_in = |name: String| {
        let known = procedural::NAMES.join(", ");
        let expected =
            format!("one of the built-in scenes ({known}, random-<seed>), or --data with the folder that holds it");
        ensure!(procedural::check_name(&name).is_ok(), "{place} {name}: expected {expected}");
        Ok((name.clone(), SceneSource::Procedural(name)))
    };
    let Some(data) = data else {
        let names = names.unwrap_or_else(|| procedural::CLASSICS.iter().map(|&name| name.to_owned()).collect());
        return names.iter().flat_map(|name| expand(name)).map(built_in).collect();
    };
    let in_folder = |name: String| {
        check_name(place, &name)?;
        let path = data.join(&name);
        ensure!(path.is_dir(), "{place} {name}: expected the scene's folder {}: not found", path.display());
        Ok((name, SceneSource::Folder { path }))
    };
    names.map_or_else(|| subfolders(data), Ok)?.into_iter().map(in_folder).collect()
}

/// Expands a range of random scenes: `random-0..2` stands for random-0, random-1 and random-2; any other name is itself.
fn expand(name: &str) -> Vec<String> {
    let range = name.strip_prefix("random-").and_then(|range| parse_seeds(range).ok());
    range.map_or_else(|| vec![name.to_owned()], |seeds| seeds.map(|seed| format!("random-{seed}")).collect())
}

fn subfolders(data: &Path) -> Result<Vec<String>> {
    let expected = format!("{}: expected a folder of scenes", data.display());
    let entries = std::fs::read_dir(data).with_context(|| expected.clone())?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_dir())
        .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    let is_scene = |path: &Path| SceneSource::Folder { path: path.to_owned() }.is_scene();
    if names.is_empty() || is_scene(data) {
        let whole = data.canonicalize().unwrap_or_else(|_| data.to_owned());
        let (Some(parent), Some(name)) = (whole.parent(), whole.file_name()) else { bail!(expected) };
        let [parent, name] = [parent.as_os_str(), name].map(|part| part.display().to_string());
        let [parent, name] = [shlex::try_quote(&parent)?, shlex::try_quote(&name)?];
        bail!("{expected}; if it is one scene: --data {parent} --scene {name}");
    }
    // Folders of runs and images may lie next to scenes. If no folder is a scene, loading reports what a scene needs.
    let scenes: Vec<String> = names.iter().filter(|name| is_scene(&data.join(name))).cloned().collect();
    Ok(if scenes.is_empty() { names } else { scenes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_a_file_system_refuses_have_a_fault() {
        for name in ["lego", "my scene", "nerf+key", "my exp", "λ₁=1e-3", "a.b", ".hidden", "(1)"] {
            assert!(check_name("scene", name).is_ok(), "{name}");
        }
        let long = "x".repeat(256);
        for name in ["", ".", "..", "a/b", "a\\b", "a\nb", "a:b", "what?", "end.", "end ", &long] {
            let fault = check_name("scene", name).expect_err(name).to_string();
            assert_eq!(fault.lines().count(), 1, "{fault}");
        }
    }

    /// A folder of photographs, or of the files of a scene, is refused where a folder of scenes is expected.
    #[test]
    fn a_scene_itself_is_refused_with_what_to_type() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("my scene");
        std::fs::create_dir(&dir).unwrap();
        for file in ["a.jpg", "transforms.json"] {
            std::fs::write(dir.join(file), "").unwrap();
            let text = find_scenes(Some(&dir), None, "--data").unwrap_err().to_string();
            let parent = guard.path().canonicalize().unwrap();
            assert!(text.ends_with(&format!("--data {} --scene 'my scene'", parent.display())), "{text}");
            std::fs::create_dir_all(dir.join("images")).unwrap();
        }
    }
}
