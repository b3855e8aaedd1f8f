//! Identity of a run: checksums of all that its numbers depend on. A run is only continued if none of them has changed.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use anyhow::{Context, Result, bail, ensure};
use infonerf_dataset::SceneSource;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::run_plan::{RunPlan, file_paths};

const NAME: &str = "identity.json";

pub(crate) const REMEDY: &str = "--overwrite starts the run anew, another --out keeps it";

/// Keys of the config whose values may grow when a run is continued.
const GROWING: [&str; 2] = ["budget_seconds", "config.train.iterations"];

/// Checksums of all that a run's numbers depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Identity {
    config: String,
    /// Checksum of the scene's files, or the name of a built-in scene.
    pub(crate) data: String,
    program: String,
    device: String,
    /// Checksum of the files that the field is initialised from.
    first_files: String,
    /// Keys that have grown since the run began.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    grown: String,
}

impl Identity {
    /// Returns the identity, on the device called `device`, of a run over the scenes of `plans`, which differ in these alone.
    pub(crate) fn of(plans: &[RunPlan], device: &str) -> Result<Self> {
        let data = plans.iter().map(|plan| match &plan.source {
            SceneSource::Procedural(name) => Ok(name.clone()),
            SceneSource::Folder { path } => folder_checksum(path),
        });
        Ok(Self {
            config: short(blake3::hash(plans[0].to_toml()?.as_bytes())),
            data: data.collect::<Result<Vec<_>>>()?.join(" "),
            program: program_checksum()?,
            device: device.to_owned(),
            first_files: files_checksum(&plans[0])?,
            grown: String::new(),
        })
    }

    /// Reads the identity of the run in `folder`; `None` if it has none, or one of an earlier version.
    fn read(folder: &Path) -> Option<Self> {
        serde_json::from_slice(&fs::read(folder.join(NAME)).ok()?).ok()
    }

    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        let text = serde_json::to_vec_pretty(self)?;
        Ok(infonerf_report::write_atomically(&folder.join(NAME), &text)?)
    }

    /// Refuses to continue the run in `folder` unless it was begun with this identity, by `config`, the text of its
    /// `config.toml`, or with fewer steps or a smaller budget. Returns whether these have grown. An error names the first key
    /// whose value differs, or what else has changed, and what can be done.
    pub(crate) fn check_continuation(&mut self, folder: &Path, config: &str) -> Result<bool> {
        let path = folder.join("config.toml");
        let damaged = || format!("{}: expected the config that the run was begun with ({REMEDY})", path.display());
        let begun = fs::read_to_string(&path).with_context(damaged)?;
        let differences = differences(&begun.parse::<Table>().with_context(damaged)?, &config.parse()?);
        let other = differences.iter().find(|difference| !difference.is_growth());
        if begun != config && (other.is_some() || differences.is_empty()) {
            let difference = other.map_or("its text differs".to_owned(), ToString::to_string);
            bail!("{}: the run that is there has another config: {difference}; {REMEDY}", path.display());
        }
        let Some(then) = Self::read(folder) else {
            bail!("{}: identity.json is missing or of another version; {REMEDY}", folder.display());
        };
        let mut changes = self.changes(&then);
        changes.retain(|what| differences.is_empty() || *what != "the config");
        let changed = changes.join(" and ");
        ensure!(changes.is_empty(), "{}: {changed} changed since the run began; {REMEDY}", folder.display());
        let grown = std::iter::once(then.grown).filter(|grown| !grown.is_empty());
        self.grown = grown.chain(differences.iter().map(ToString::to_string)).collect::<Vec<_>>().join(", ");
        Ok(!differences.is_empty())
    }

    pub(crate) fn grown(&self) -> Option<String> {
        let went_on = format!("training went on after its end: {}", self.grown);
        (!self.grown.is_empty()).then(|| format!("{went_on}; schedules were computed anew for the new length"))
    }

    /// Names the parts that differ from the run that was begun as `then`.
    fn changes(&self, then: &Self) -> Vec<&'static str> {
        let parts = [
            ("the config", self.config != then.config),
            ("the scene's files", self.data != then.data),
            ("the program", self.program != then.program),
            ("the device", self.device != then.device),
            ("the files that the field is initialised from", self.first_files != then.first_files),
        ];
        parts.into_iter().filter_map(|(what, is_changed)| is_changed.then_some(what)).collect()
    }
}

pub(crate) struct Difference {
    pub(crate) key: String,
    then: String,
    pub(crate) now: String,
}

impl Difference {
    /// Whether the key is one of `GROWING` and its value has grown.
    fn is_growth(&self) -> bool {
        let [then, now] = [&self.then, &self.now].map(|value| value.parse::<f64>().ok());
        GROWING.contains(&self.key.as_str()) && then.zip(now).is_some_and(|(then, now)| then < now)
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} was {} and is {}", self.key, self.then, self.now)
    }
}

/// Returns the keys at which two configs differ, in alphabetical order. A value that replaces a schedule differs as a whole.
pub(crate) fn differences(then: &Table, now: &Table) -> Vec<Difference> {
    let keys: BTreeSet<&String> = then.keys().chain(now.keys()).collect();
    let difference = |key: &String| match [then.get(key), now.get(key)] {
        [then, now] if then == now => Vec::new(),
        [then @ (None | Some(Value::Table(_))), now @ (None | Some(Value::Table(_)))] => {
            let [then, now] = [then, now].map(|value| value.and_then(Value::as_table).cloned().unwrap_or_default());
            let below = differences(&then, &now).into_iter();
            below.map(|difference| Difference { key: format!("{key}.{}", difference.key), ..difference }).collect()
        }
        values => {
            let [then, now] = values.map(|value| value.map_or("absent".to_owned(), Value::to_string));
            vec![Difference { key: key.clone(), then, now }]
        }
    };
    keys.into_iter().flat_map(difference).collect()
}

fn short(hash: blake3::Hash) -> String {
    hash.to_hex()[..16].to_owned()
}

/// Returns the checksum of the names and contents of the scene's files below `folder`, read once per process.
fn folder_checksum(folder: &Path) -> Result<String> {
    static KNOWN: Mutex<BTreeMap<PathBuf, String>> = Mutex::new(BTreeMap::new());
    if let Some(checksum) = KNOWN.lock().ok().and_then(|known| known.get(folder).cloned()) {
        return Ok(checksum);
    }
    let mut files = Vec::new();
    collect(folder, &mut HashSet::new(), &mut files).with_context(|| folder.display().to_string())?;
    let mut hasher = blake3::Hasher::new();
    for path in files {
        let relative = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().into_owned();
        hasher.update(&(relative.len() as u64).to_le_bytes()).update(relative.as_bytes());
        hash_file(&path, &mut hasher).with_context(|| path.display().to_string())?;
    }
    let checksum = short(hasher.finalize());
    if let Ok(mut known) = KNOWN.lock() {
        known.insert(folder.to_owned(), checksum.clone());
    }
    Ok(checksum)
}

/// Names of files that mark a folder as one of results, which is not part of a scene.
const RESULT_FILES: [&str; 4] = ["lock", "identity.json", "results.json", "manifest.jsonl"];

/// Whether a path may be part of a scene: neither hidden, nor a file that Windows adds, nor a dangling link, nor a named pipe.
fn may_matter(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_foreign = name.starts_with('.') || matches!(&*name, "Thumbs.db" | "desktop.ini");
    !is_foreign && (path.is_dir() || path.is_file())
}

/// Collects the files below `folder` in the order of their names. Skips what cannot matter, folders of results, which may lie
/// inside a scene's folder, and folders that were visited before, to which links may lead back.
fn collect(folder: &Path, seen: &mut HashSet<PathBuf>, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !seen.insert(folder.canonicalize()?) {
        return Ok(());
    }
    let mut paths = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<PathBuf>>>()?;
    paths.retain(|path| may_matter(path));
    paths.sort();
    for path in paths {
        match path.is_dir() {
            true if RESULT_FILES.iter().any(|name| path.join(name).is_file()) => {}
            true => collect(&path, seen, files)?,
            false => files.push(path),
        }
    }
    Ok(())
}

fn hash_file(path: &Path, hasher: &mut blake3::Hasher) -> std::io::Result<()> {
    let file = fs::File::open(path)?;
    hasher.update(&file.metadata()?.len().to_le_bytes()).update_reader(file)?;
    Ok(())
}

/// Returns the checksum of the executable: another build may give other numbers.
fn program_checksum() -> Result<String> {
    static KNOWN: OnceLock<String> = OnceLock::new();
    if let Some(checksum) = KNOWN.get() {
        return Ok(checksum.clone());
    }
    let path = std::env::current_exe().context("the program's own file")?;
    let mut hasher = blake3::Hasher::new();
    hash_file(&path, &mut hasher).with_context(|| path.display().to_string())?;
    Ok(KNOWN.get_or_init(|| short(hasher.finalize())).clone())
}

fn files_checksum(plan: &RunPlan) -> Result<String> {
    let mut config = plan.config.clone();
    for (_, unused) in config.loss.specs_mut().filter(|(_, spec)| spec.weight().is_zero()) {
        unused.weights_file().into_iter().for_each(|(_, path)| path.clear());
    }
    // The folder of a run stands for the weights of its checkpoint. A missing file is reported later, when it is used.
    let file = |path: &mut PathBuf| if path.is_dir() { path.join("checkpoint/model.bpk") } else { path.clone() };
    let files: Vec<PathBuf> = file_paths(&mut config).into_iter().map(file).filter(|path| path.is_file()).collect();
    let mut hasher = blake3::Hasher::new();
    for file in &files {
        hash_file(file, &mut hasher).with_context(|| file.display().to_string())?;
    }
    Ok(if files.is_empty() { String::new() } else { short(hasher.finalize()) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::first_run;

    #[test]
    fn every_part_makes_a_difference() {
        let plan = |set: &str| [first_run(&[set])];
        let first = Identity::of(&plan("train.rays=64"), "flex").unwrap();
        assert_eq!(first, Identity::of(&plan("train.rays=64"), "flex").unwrap());
        let other = Identity::of(&plan("train.rays=65"), "ndarray").unwrap();
        assert_eq!(other.changes(&first), ["the config", "the device"]);
        let [then, now] =
            ["train.lr = { from = 0.002, to = 0.001 }", "train.lr = 0.002"].map(|text| text.parse().unwrap());
        let differences: Vec<String> = differences(&then, &now).iter().map(ToString::to_string).collect();
        assert_eq!(differences, ["train.lr was { from = 0.002, to = 0.001 } and is 0.002"]);
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Identity::read(folder.path()), None);
        first.write(folder.path()).unwrap();
        assert_eq!(Identity::read(folder.path()), Some(first));
    }

    #[test]
    fn a_scene_is_its_images_without_results_and_circles_of_links() {
        // Each scene has a folder of its own, since a process computes the checksum of a folder only once.
        let scene_with = |add: &dyn Fn(&Path)| {
            let folder = tempfile::tempdir().unwrap();
            write(folder.path(), "train/r_0.png", "one");
            add(folder.path());
            folder_checksum(folder.path()).unwrap()
        };
        let same = scene_with(&|_| ());
        assert_ne!(same, scene_with(&|scene| write(scene, "train/r_0.png", "two")));
        assert_ne!(same, scene_with(&|scene| write(scene, "train/r_1.png", "one")));
        let with_results = scene_with(&|scene| {
            for file in ["exp/scene/nerf/seed0/lock", "exp/scene/nerf/seed0/metrics.jsonl", "other/results.json"] {
                write(scene, &format!("runs/{file}"), "");
            }
        });
        assert_eq!(same, with_results);
        let foreign = [".DS_Store", "train/._r_0.png", "train/Thumbs.db", "desktop.ini", ".git/config"];
        assert_eq!(same, scene_with(&|scene| foreign.iter().for_each(|file| write(scene, file, "foreign"))));
        #[cfg(unix)]
        let with_links_and_pipe = scene_with(&|scene| {
            let link = |to: &str, name: &str| std::os::unix::fs::symlink(to, scene.join(name)).unwrap();
            link("..", "train/above");
            link("nowhere", "train/lost.png");
            assert!(std::process::Command::new("mkfifo").arg(scene.join("pipe")).status().unwrap().success());
        });
        #[cfg(unix)]
        assert_eq!(same, with_links_and_pipe);
    }

    fn write(scene: &Path, file: &str, text: &str) {
        let path = scene.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
}
