//! The runs below a folder.

use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

/// How deep runs lie below the folder at most: `runs/<experiment>/<scene>/<variant>/seed<N>`.
const DEPTH: usize = 5;
/// Runs that are listed at most.
const MOST: usize = 2000;
/// A log that was written to so recently is of a run that trains.
const LIVELY: Duration = Duration::from_secs(20);

/// The runs below `root`, by path, as the page lists them.
pub(super) fn list(root: &Path) -> Value {
    let mut runs = Vec::new();
    collect(root, DEPTH, &mut runs);
    runs.sort();
    runs.iter().map(|run| describe(root, run)).collect()
}

/// The folder of a run that the page named: below `root`, links followed; none if it is not, or is no run.
pub(super) fn resolve(root: &Path, run: &str) -> Option<PathBuf> {
    let relative = Path::new(run);
    let plain = relative.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !plain {
        return None;
    }
    let folder = root.join(relative).canonicalize().ok()?;
    (folder.starts_with(root) && is_run(&folder)).then_some(folder)
}

/// The folder of the run's first field.
pub(super) fn first_field(run: &Path) -> PathBuf {
    let member = run.join("member0");
    if member.is_dir() { member } else { run.to_owned() }
}

/// When the first field's newest checkpoint was written, in milliseconds; 0 without one.
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
        if depth > 0 && runs.len() < MOST {
            collect(&entry.path(), depth - 1, runs);
        }
    }
}

fn describe(root: &Path, run: &Path) -> Value {
    let parts = run.strip_prefix(root).unwrap_or(run).components();
    let parts: Vec<_> = parts.map(|part| part.as_os_str().to_string_lossy()).collect();
    let path = if parts.is_empty() { ".".to_owned() } else { parts.join("/") };
    let own = || run.components().rev().take(3).map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>();
    let name = if parts.is_empty() { own().into_iter().rev().collect::<Vec<_>>().join("/") } else { path.clone() };
    json!({ "run": path, "name": name, "state": state(run), "stamp": stamp(run) })
}

/// Whether a run has its record.
pub(super) fn is_finished(run: &Path) -> bool {
    let mut names = fs::read_dir(run).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.any(|name| name.to_string_lossy().starts_with("record-"))
}

fn state(run: &Path) -> &'static str {
    let recent = |path: &Path| written(path).and_then(|time| time.elapsed().ok()).is_some_and(|age| age < LIVELY);
    if is_finished(run) {
        "finished"
    } else if recent(&first_field(run).join("metrics.jsonl")) {
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

    fn folder() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("runs").canonicalize().unwrap_or_else(|_| {
            fs::create_dir_all(folder.path().join("runs")).unwrap();
            folder.path().join("runs").canonicalize().unwrap()
        });
        for run in ["e/castle/nerf/seed0", "e/castle/infonerf+/seed0"] {
            fs::create_dir_all(root.join(run)).unwrap();
            fs::write(root.join(run).join("config.toml"), "").unwrap();
        }
        (folder, root)
    }

    #[test]
    fn runs_are_listed_by_path() {
        let (_folder, root) = folder();
        fs::write(root.join("e/castle/nerf/seed0/record-fast.json"), "[]").unwrap();
        let listed = list(&root);
        let shown: Vec<_> = listed.as_array().unwrap().iter().map(|run| (&run["run"], &run["state"])).collect();
        let (plus, nerf) = (json!("e/castle/infonerf+/seed0"), json!("e/castle/nerf/seed0"));
        assert_eq!(shown, [(&plus, &json!("not finished")), (&nerf, &json!("finished"))]);
        let own = list(&root.join("e/castle/nerf/seed0"));
        assert_eq!((&own[0]["run"], &own[0]["name"]), (&json!("."), &json!("castle/nerf/seed0")));
    }

    #[test]
    fn nothing_outside_the_folder_is_a_run() {
        let (folder, root) = folder();
        fs::write(folder.path().join("config.toml"), "").unwrap();
        assert_eq!(resolve(&root, "e/castle/nerf/seed0"), Some(root.join("e/castle/nerf/seed0")));
        let outside = folder.path().to_string_lossy().into_owned();
        for run in ["..", "e/../..", "../runs/../", "e", "", "nowhere", "e/castle/nerf/seed0/config.toml", &outside] {
            assert_eq!(resolve(&root, run), None, "{run}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path(), root.join("link")).unwrap();
            assert_eq!(resolve(&root, "link"), None);
        }
    }
}
