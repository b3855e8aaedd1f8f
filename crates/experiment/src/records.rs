//! Records of runs on disk: a file in each run's folder, and `results.json` with all records of an experiment.
//!
//! `results.json` is derived from the runs' own files, `<scene>/<variant>/seed<N>/record-<preset>.json`, and may be written
//! by several processes at once without a lock: a process that has written it reads it again, and starts over if another run
//! was added in between. A record is on disk before its process first derives the list, so that the last of them sees all.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use infonerf_report::{Record, run_directory, write_atomically};
use serde_json::Value;
use walkdir::WalkDir;

pub(crate) const LIST: &str = "results.json";
const ATTEMPTS: usize = 1000;

/// Reads a list of records. Unknown keys are ignored; an optional metric that is missing is `None`.
///
/// # Errors
/// If the file is no JSON list of records: one line that names the file, the record and its field.
pub fn read_records(path: &Path) -> Result<Vec<Record>> {
    let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    parse_records(&text).with_context(|| path.display().to_string())
}

/// Writes a list of records, whole or not at all, each made [representable](Record::representable).
fn write_records(path: &Path, records: &[Record]) -> Result<()> {
    let records: Vec<Record> = records.iter().cloned().map(Record::representable).collect();
    let mut bytes = serde_json::to_vec_pretty(&records)?;
    bytes.push(b'\n');
    Ok(write_atomically(path, &bytes)?)
}

/// Writes a run's own record below the experiment's `folder`. The file marks the run as finished.
pub(crate) fn save_own_record(folder: &Path, record: &Record) -> Result<()> {
    let run = folder.join(run_directory(&record.scene, &record.variant, record.seed));
    write_records(&run.join(format!("record-{}.json", record.preset)), std::slice::from_ref(record))
}

/// Saves a finished run's record, in its own file and in the `results.json` of the experiment's `folder`.
///
/// # Errors
/// As [`read_records`], and if the file cannot be written.
pub fn save_record(folder: &Path, record: &Record) -> Result<()> {
    save_own_record(folder, record)?;
    list_records(folder, std::slice::from_ref(record))
}

/// Adds `records`, and the records of all runs below the experiment's `folder`, to its `results.json`. Entries keep their
/// places, new ones come last, and entries of deleted runs stay.
pub(crate) fn list_records(folder: &Path, records: &[Record]) -> Result<()> {
    let path = folder.join(LIST);
    let given: Vec<Record> = records.iter().cloned().map(Record::representable).collect();
    for _ in 0..ATTEMPTS {
        let listed = if path.exists() { Some(read_records(&path)?) } else { None };
        let merged = merge(listed.clone().unwrap_or_default(), &given, stored_records(folder)?);
        if listed.as_ref() == Some(&merged) {
            return Ok(());
        }
        write_records(&path, &merged)?;
    }
    bail!("{}: other processes kept writing it; the records themselves are saved", path.display())
}

/// Merges records by key. Records of `listed` keep their places, where newer records of the same key from `given` (in the
/// order of `given`) or `stored` replace them. The other records of `given` and of `stored` follow at the end.
fn merge(listed: Vec<Record>, given: &[Record], stored: Vec<Record>) -> Vec<Record> {
    let given_keys: BTreeSet<_> = given.iter().map(Record::key).collect();
    let keyed = stored.into_iter().map(|record| (record.key(), record));
    let mut stored: BTreeMap<_, Record> = keyed.filter(|(key, _)| !given_keys.contains(key)).collect();
    let mut given = given.iter().cloned();
    let replace = |record: Record| {
        let key = record.key();
        if given_keys.contains(&key) { given.next() } else { Some(stored.remove(&key).unwrap_or(record)) }
    };
    let mut merged: Vec<Record> = listed.into_iter().filter_map(replace).collect();
    merged.extend(given);
    merged.extend(stored.into_values());
    merged
}

fn stored_records(folder: &Path) -> Result<Vec<Record>> {
    /// Depth of the files of a run: `<scene>/<variant>/seed<N>/<file>`.
    const DEPTH: usize = 4;
    let files = WalkDir::new(folder).min_depth(DEPTH).max_depth(DEPTH).follow_links(true).sort_by_file_name();
    let mut records = Vec::new();
    for file in files {
        match file {
            Ok(file) if is_own_record(file.path()) => records.extend(read_records(file.path())?),
            Ok(_) => {}
            // A run may be removed meanwhile, and a link may lead in a circle.
            Err(error) if error.io_error().is_none_or(|error| error.kind() == ErrorKind::NotFound) => {}
            Err(error) => return Err(error).with_context(|| folder.display().to_string()),
        }
    }
    Ok(records)
}

/// Names the first folder below `folder` that has a file `name`, for errors about `folder` that has none.
pub(crate) fn found_below(folder: &Path, name: &str) -> String {
    /// Depth of a run's files below a folder of results: `<experiment>/<scene>/<variant>/seed<N>/<file>`.
    const DEPTH: usize = 5;
    if !folder.exists() {
        return ": not found".to_owned();
    }
    let files = WalkDir::new(folder).max_depth(DEPTH).sort_by_file_name().into_iter().flatten();
    let found = files.filter(|file| file.file_name() == name).find_map(|file| Some(file.path().parent()?.to_owned()));
    found.map_or_else(String::new, |found| format!(", such as {}", found.display()))
}

pub(crate) fn is_own_record(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(|name| name.starts_with("record-") && name.ends_with(".json"))
}

fn parse_records(text: &str) -> Result<Vec<Record>> {
    let values: Vec<Value> = serde_json::from_str(text).map_err(|error| anyhow!("not a list of records: {error}"))?;
    let parse = |(index, value): (usize, Value)| {
        serde_path_to_error::deserialize(value).map_err(|error| anyhow!("record {index}: {error}"))
    };
    values.into_iter().enumerate().map(parse).collect()
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;
    use std::thread;

    use super::*;
    use crate::testing::with_psnr;

    fn record(scene: &str, variant: &str, seed: u64) -> Record {
        let [experiment, scene, variant, preset] = ["e", scene, variant, "fast"].map(str::to_owned);
        let record = Record { experiment, scene, variant, seed, preset, ..Record::default() };
        with_psnr(18.123_456_789_012_345, record)
    }

    /// Saving again replaces in place, records of deleted runs stay, and a run that ends late takes its place among the others.
    #[test]
    fn records_keep_their_places() {
        let folder = tempfile::tempdir().unwrap();
        let listed = || read_records(&folder.path().join(LIST)).unwrap();
        let (first, second) = (record("lego", "nerf", 0), record("lego", "infonerf", 0));
        let better = with_psnr(20.0, first.clone());
        for saved in [&first, &second, &better] {
            save_record(folder.path(), saved).unwrap();
        }
        assert_eq!(listed(), [better.clone(), second.clone()]);
        fs::remove_dir_all(folder.path().join("lego")).unwrap();
        let paper = Record { preset: "paper".into(), ..first };
        save_record(folder.path(), &paper).unwrap();
        let own = ["a", "b", "c"].map(|variant| record("fern", variant, 0));
        list_records(folder.path(), &[own[0].clone(), own[2].clone()]).unwrap();
        list_records(folder.path(), &own).unwrap();
        assert_eq!(listed(), [&[better, second, paper], &own[..]].concat());
    }

    #[test]
    fn many_writers_lose_nothing() {
        let folder = tempfile::tempdir().unwrap();
        thread::scope(|scope| {
            for seed in 0..8 {
                let path = folder.path();
                scope.spawn(move || {
                    for variant in ["a", "b", "c"] {
                        save_record(path, &record("lego", variant, seed)).unwrap();
                    }
                });
            }
        });
        assert_eq!(read_records(&folder.path().join(LIST)).unwrap().len(), 24);
        let files = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        assert_eq!(
            files.collect::<BTreeSet<_>>(),
            ["lego", LIST].map(OsString::from).into(),
            "nothing half-written is left"
        );
    }

    #[test]
    fn values_that_json_cannot_hold_are_null_with_a_note() {
        let folder = tempfile::tempdir().unwrap();
        save_record(folder.path(), &with_psnr(f64::INFINITY, record("lego", "nerf", 0))).unwrap();
        let saved = read_records(&folder.path().join(LIST)).unwrap().remove(0);
        assert_eq!((saved.metrics["psnr"], saved.notes.len()), (None, 1));
    }

    #[test]
    fn errors_name_the_record_and_the_field() {
        let fault = |text: &str| parse_records(text).unwrap_err().to_string();
        let mut value = serde_json::to_value([record("lego", "nerf", 0)]).unwrap();
        value[0]["psnr"] = "high".into();
        let error = fault(&value.to_string());
        assert!(error.starts_with("record 0: psnr: invalid type: string \"high\""), "{error}");
        value[0]["psnr"] = Value::Null;
        value[0]["test_views"]["count"] = "all".into();
        let error = fault(&value.to_string());
        assert!(error.starts_with("record 0: test_views.count: invalid type: string \"all\""), "{error}");
        value[0]["test_views"]["count"] = 0.into();
        value[0].as_object_mut().unwrap().remove("device");
        assert_eq!(fault(&value.to_string()), "record 0: missing field `device`");
        assert!(fault("[{").starts_with("not a list of records: EOF"));
    }
}
