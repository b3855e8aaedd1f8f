use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use infonerf_report::{EVENTS_FILE, VIEWER_PAGE};

use crate::records::is_own_record;

/// Names of the folders that a run creates, in addition to those of its members.
const FOLDERS: [&str; 9] =
    ["checkpoint", "checkpoint.previous", "checkpoint.writing", "test", "depth", "error", "truth", "render", "export"];

/// Files that only a checkpoint of the first field has.
const CHECKPOINTS: [&str; 2] = ["checkpoint/manifest.json", "member0/checkpoint/manifest.json"];

/// Whether the run in `folder` is finished: it has written a record.
pub fn is_finished(folder: &Path) -> bool {
    own_records(folder).next().is_some()
}

pub(crate) fn has_results(folder: &Path) -> bool {
    is_finished(folder) || CHECKPOINTS.iter().any(|name| folder.join(name).exists())
}

fn own_records(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| is_own_record(path))
}

fn remove_files(paths: impl Iterator<Item = PathBuf>) -> Result<()> {
    let remove = |path: PathBuf| fs::remove_file(&path).with_context(|| path.display().to_string());
    paths.filter(|path| path.exists()).try_for_each(remove)
}

/// Removes what an earlier run left in `folder`. A folder in it that holds runs itself, of a scene, is kept.
pub(crate) fn clear(folder: &Path) -> Result<()> {
    // The config is removed after all that `has_results` finds: after an interruption the run goes on, or counts as not begun.
    let files = CHECKPOINTS.into_iter().chain(["config.toml", EVENTS_FILE, VIEWER_PAGE]);
    remove_files(own_records(folder).chain(files.map(|name| folder.join(name))))?;
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())?.flatten() {
        let (name, path) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
        let member = name.strip_prefix("member").is_some_and(|index| index.parse::<usize>().is_ok());
        if path.is_dir() && (FOLDERS.contains(&name.as_str()) || member) && !holds_runs(&path) {
            fs::remove_dir_all(&path).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}

/// Whether `scene` is the folder of a scene, with runs of variants in it.
fn holds_runs(scene: &Path) -> bool {
    let children = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    children(scene.to_owned()).flat_map(children).any(|run| run.join("config.toml").exists())
}

/// Prepares a run for more training: removes record, page and orbit, and moves the files of its one field to `first`.
pub(crate) fn reopen(folder: &Path, first: &Path) -> Result<()> {
    let pages = [VIEWER_PAGE, "render/orbit.gif"].map(|name| folder.join(name));
    remove_files(own_records(folder).chain(pages))?;
    fs::create_dir_all(first).with_context(|| first.display().to_string())?;
    for name in ["checkpoint", "checkpoint.previous", EVENTS_FILE] {
        let (from, to) = (folder.join(name), first.join(name));
        if from != to && from.exists() {
            fs::rename(&from, &to).with_context(|| from.display().to_string())?;
        }
    }
    Ok(())
}

/// Locks the folder of a run or a sweep (`what`) until the returned file is dropped; warns if the file system has no locks.
pub(crate) fn lock(folder: &Path, what: &str) -> Result<(fs::File, Option<String>)> {
    let path = folder.join("lock");
    let file = fs::File::create(&path).with_context(|| path.display().to_string())?;
    // The lock of a process that was just killed may outlive it by a moment.
    let patience = Instant::now() + Duration::from_secs(1);
    loop {
        match file.try_lock() {
            Ok(()) => return Ok((file, None)),
            Err(fs::TryLockError::WouldBlock) if Instant::now() < patience => sleep(Duration::from_millis(20)),
            Err(fs::TryLockError::WouldBlock) => {
                bail!(
                    "{}: another process is at work on this {what}; wait for it, or name another --out",
                    folder.display()
                )
            }
            Err(fs::TryLockError::Error(error)) => return without_lock(file, &error, folder),
        }
    }
}

fn without_lock(file: fs::File, error: &std::io::Error, folder: &Path) -> Result<(fs::File, Option<String>)> {
    // Network file systems without locks return ENOLCK.
    const ENOLCK: i32 = 37;
    if error.kind() == ErrorKind::Unsupported || error.raw_os_error() == Some(ENOLCK) {
        let warning =
            format!("{}: the file system has no locks: see that no other process runs this", folder.display());
        return Ok((file, Some(warning)));
    }
    bail!("{}: cannot be locked: {error}", folder.display())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn only_what_a_run_wrote_is_removed() {
        let guard = tempfile::tempdir().unwrap();
        let folder = guard.path();
        // A scene is called "truth" in the folder of a pre-training.
        for name in ["test", "member0", "member12", "members", "notes", "truth/nerf/seed0"] {
            fs::create_dir_all(folder.join(name)).unwrap();
        }
        for name in ["config.toml", "metrics.jsonl", "notes.txt", "record-fast.json", "truth/nerf/seed0/config.toml"] {
            fs::write(folder.join(name), "").unwrap();
        }
        assert!(has_results(folder));
        clear(folder).unwrap();
        assert!(!has_results(folder));
        let left = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        assert_eq!(left.collect::<BTreeSet<_>>(), ["members", "notes", "notes.txt", "truth"].map(String::from).into());
    }

    #[test]
    fn a_file_system_without_locks_is_no_obstacle() {
        let folder = tempfile::tempdir().unwrap();
        let file = || fs::File::create(folder.path().join("lock")).unwrap();
        for error in [ErrorKind::Unsupported.into(), std::io::Error::from_raw_os_error(37)] {
            let (_, warning) = without_lock(file(), &error, folder.path()).unwrap();
            assert!(warning.unwrap().contains("no locks"));
        }
        assert!(without_lock(file(), &ErrorKind::PermissionDenied.into(), folder.path()).is_err());
    }
}
