//! Runs below the served folders.

use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use infonerf_experiment::is_finished;
use infonerf_report::EVENTS_FILE;
use serde_json::{Value, json};

/// Maximum depth of a run below the folder: `runs/<experiment>/<scene>/<variant>/seed<N>`.
const DEPTH: usize = 5;
const MAX_LISTED: usize = 2000;
/// Maximum age of the log of a run that counts as training.
const LIVELY: Duration = Duration::from_secs(20);

/// Served folders, each of which is a run or holds runs. The name of a run is the number of its folder and its path below
/// the folder, as in `0/castle/infonerf/seed0`, or `0/.` for the folder itself.
pub(super) struct Roots(Vec<Root>);

struct Root {
    /// Canonical path.
    folder: PathBuf,
    /// Path as the user wrote it.
    given: PathBuf,
}

impl Roots {
    pub(super) fn new(roots: &[PathBuf]) -> Result<Self> {
        let root = |given: &PathBuf| {
            let folder = given.canonicalize().ok().filter(|folder| folder.is_dir());
            let expected = || format!("{}: expected the folder of a run, or one that holds runs", given.display());
            Ok(Root { folder: folder.with_context(expected)?, given: given.clone() })
        };
        Ok(Self(roots.iter().map(root).collect::<Result<_>>()?))
    }

    pub(super) fn list(&self) -> Value {
        let several = self.0.len() > 1;
        let of_root = |(index, root): (usize, &Root)| {
            let mut runs = Vec::new();
            collect(&root.folder, DEPTH, &mut runs);
            runs.sort();
            runs.iter().map(|run| root.describe(index, run, several)).collect::<Vec<_>>()
        };
        self.0.iter().enumerate().flat_map(of_root).collect()
    }

    /// Returns the folder of the run that the page calls `run`, with links resolved; `None` if no served folder has such a run.
    pub(super) fn resolve(&self, run: &str) -> Option<PathBuf> {
        let (index, relative) = run.split_once('/')?;
        let root = &self.0.get(index.parse::<usize>().ok()?)?.folder;
        let relative = Path::new(relative);
        let plain = relative.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        let folder = root.join(relative).canonicalize().ok().filter(|_| plain)?;
        (folder.starts_with(root) && is_run(&folder)).then_some(folder)
    }
}

impl Root {
    fn describe(&self, index: usize, run: &Path, several: bool) -> Value {
        let joined = |parts: Vec<Component<'_>>| {
            parts.iter().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
        };
        let path = joined(run.strip_prefix(&self.folder).unwrap_or(run).components().collect());
        let name = match (several, path.is_empty()) {
            (true, _) => self.given.join(&path).display().to_string().trim_end_matches('/').to_owned(),
            (false, false) => path.clone(),
            // A single run has the name of its scene, variant and seed.
            (false, true) => joined(run.components().skip(run.components().count().saturating_sub(3)).collect()),
        };
        let path = if path.is_empty() { "." } else { &path };
        json!({ "run": format!("{index}/{path}"), "name": name, "state": state(run), "stamp": stamp(run) })
    }
}

pub(super) fn first_field(run: &Path) -> PathBuf {
    let member = run.join("member0");
    if member.is_dir() { member } else { run.to_owned() }
}

/// Returns the time at which the first field's newest checkpoint was written, in milliseconds; 0 without one.
pub(super) fn stamp(run: &Path) -> u64 {
    written(&first_field(run).join("checkpoint/manifest.json"))
        .and_then(|time| time.duration_since(UNIX_EPOCH).ok())
        .map_or(0, |time| time.as_millis() as u64)
}

fn is_run(folder: &Path) -> bool {
    folder.join("config.toml").is_file()
}

fn collect(folder: &Path, depth: usize, runs: &mut Vec<PathBuf>) {
    if is_run(folder) {
        runs.push(folder.to_owned());
        return;
    }
    let Ok(entries) = fs::read_dir(folder) else { return };
    // Links are not followed: they could lead in a circle.
    let below = entries.flatten().filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    for entry in below {
        if depth > 0 && runs.len() < MAX_LISTED {
            collect(&entry.path(), depth - 1, runs);
        }
    }
}

fn state(run: &Path) -> &'static str {
    let recent = |path: &Path| written(path).and_then(|time| time.elapsed().ok()).is_some_and(|age| age < LIVELY);
    if is_finished(run) {
        "finished"
    } else if recent(&first_field(run).join(EVENTS_FILE)) {
        "training"
    } else {
        "not finished"
    }
}

fn written(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).ok()?.modified().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_listed_by_path() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        for run in ["e/castle/nerf/seed0", "e/castle/infonerf+/seed0"] {
            fs::create_dir_all(root.join(run)).unwrap();
            fs::write(root.join(run).join("config.toml"), "").unwrap();
        }
        fs::write(root.join("e/castle/nerf/seed0/record-fast.json"), "[]").unwrap();
        let named = |roots: &[PathBuf]| -> Vec<[String; 2]> {
            let listed = Roots::new(roots).unwrap().list();
            let text = |run: &Value, key: &str| run[key].as_str().unwrap().to_owned();
            listed.as_array().unwrap().iter().map(|run| ["run", "name"].map(|key| text(run, key))).collect()
        };
        let listed = Roots::new(std::slice::from_ref(&root)).unwrap().list();
        assert_eq!([0, 1].map(|i| listed[i]["state"].as_str().unwrap()), ["not finished", "finished"]);
        let [plus, nerf] = ["e/castle/infonerf+/seed0", "e/castle/nerf/seed0"];
        let below = |index: usize, run: &str| format!("{index}/{run}");
        assert_eq!(named(std::slice::from_ref(&root)), [plus, nerf].map(|run| [below(0, run), run.to_owned()]));
        assert_eq!(named(&[root.join(nerf)]), [["0/.", "castle/nerf/seed0"]]);
        let shown = |run: &str| root.join(run).display().to_string();
        let both = named(&[root.join(nerf), root.clone()]);
        assert_eq!(both[0], ["0/.".to_owned(), shown(nerf)]);
        assert_eq!(both[1..], [plus, nerf].map(|run| [below(1, run), shown(run)]));
    }
}
