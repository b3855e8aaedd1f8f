//! `results.json`, written by several processes at once without a lock.
//!
//! Each run owns a file of its own, `<scene>/<variant>/seed<N>/record-<preset>.json`, and `results.json` is derived
//! from those. Whoever writes it looks again afterwards and starts over when a run has come in between. A record is on
//! disk before its process first derives the list, so the last process to rename `results.json` sees every record:
//! none is lost, whatever the order.

use std::{
    collections::BTreeMap,
    fs,
    io::ErrorKind,
    path::{Path, PathBuf},
};

use serde_json::Value;

use crate::{Record, ReportError, RunKey, files::write_atomically, folder_name_fault, run_directory};

const LIST: &str = "results.json";
const ATTEMPTS: usize = 1000;

/// Reads a list of records.
///
/// Keys that are not known are ignored; an optional metric that is missing reads as `None`.
///
/// # Errors
/// [`ReportError::Io`], [`ReportError::Syntax`] when it is not a JSON list, [`ReportError::Field`] which names the
/// record and its field.
pub fn read_records(path: &Path) -> Result<Vec<Record>, ReportError> {
    let text = fs::read_to_string(path).map_err(ReportError::io("read", path))?;
    parse_records(path, &text)
}

/// Writes a list of records, beside the file and then renamed.
///
/// # Errors
/// [`ReportError::Io`]; [`ReportError::Field`] when a duration is NaN or infinite. Metrics that are become `null` with
/// a note: see [`Record::representable`].
pub fn write_records(path: &Path, records: &[Record]) -> Result<(), ReportError> {
    let records: Vec<Record> = records.iter().cloned().map(Record::representable).collect();
    for (index, record) in records.iter().enumerate() {
        if let Some((field, value)) = record.non_finite_field() {
            let reason = format!("expected a finite number, found {value}");
            return Err(ReportError::Field { path: path.into(), index, field: field.into(), reason });
        }
    }
    let syntax = |error: serde_json::Error| ReportError::Syntax { path: path.into(), reason: error.to_string() };
    let mut bytes = serde_json::to_vec_pretty(&records).map_err(syntax)?;
    bytes.push(b'\n');
    write_atomically(path, &bytes)
}

/// Adds a record to the experiment in `directory`, or replaces the one with the same [`RunKey`], and returns the whole
/// list as `results.json` now holds it.
///
/// Several processes may do so at once. Entries keep their place and new ones come last. Entries of `results.json` stay
/// when the folder of their run is deleted.
///
/// # Errors
/// [`ReportError::Name`] when a name cannot be a folder's; the errors of [`read_records`] and [`write_records`];
/// [`ReportError::Contended`].
pub fn save_record(directory: &Path, record: &Record) -> Result<Vec<Record>, ReportError> {
    save_own_record(directory, record)?;
    let list = directory.join(LIST);
    for _ in 0..ATTEMPTS {
        let listed = if list.exists() { Some(read_records(&list)?) } else { None };
        let merged = merge(listed.clone().unwrap_or_default(), stored_records(directory)?);
        if listed.as_ref() == Some(&merged) {
            return Ok(merged);
        }
        write_records(&list, &merged)?;
    }
    Err(ReportError::Contended { path: list })
}

/// Writes the file of a run below `directory`, without adding it to `results.json`: for runs whose list is made once all
/// have ended.
///
/// # Errors
/// [`ReportError::Name`] when a name cannot be a folder's; the errors of [`write_records`].
pub fn save_own_record(directory: &Path, record: &Record) -> Result<(), ReportError> {
    check_names(directory, record)?;
    let own = directory
        .join(run_directory(&record.scene, &record.variant, record.seed))
        .join(format!("record-{}.json", record.preset));
    write_records(&own, std::slice::from_ref(record))
}

/// `listed` with each of `stored` in the place of its key, or at the end.
fn merge(listed: Vec<Record>, stored: Vec<Record>) -> Vec<Record> {
    let mut stored: BTreeMap<RunKey, Record> = stored.into_iter().map(|record| ((&record).into(), record)).collect();
    let mut merged: Vec<Record> =
        listed.into_iter().map(|record| stored.remove(&(&record).into()).unwrap_or(record)).collect();
    merged.extend(stored.into_values());
    merged
}

/// The records that the runs below `directory` hold themselves.
fn stored_records(directory: &Path) -> Result<Vec<Record>, ReportError> {
    let mut folders = vec![directory.to_path_buf()];
    for _level in ["scene", "variant", "seed"] {
        let children: Result<Vec<_>, _> = folders.iter().map(|folder| list(folder)).collect();
        folders = children?.into_iter().flatten().filter(|path| path.is_dir()).collect();
    }
    let mut records = Vec::new();
    for folder in folders {
        for path in list(&folder)?.into_iter().filter(|path| is_own_record(path)) {
            records.extend(read_records(&path)?);
        }
    }
    Ok(records)
}

fn is_own_record(path: &Path) -> bool {
    path.file_name()
        .and_then(|name| name.to_str())
        .is_some_and(|name| name.starts_with("record-") && name.ends_with(".json"))
}

/// Sorted entries of a folder; none when it vanished meanwhile.
fn list(folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(ReportError::io("list", folder))?,
    };
    let paths: Result<Vec<PathBuf>, _> = entries.map(|entry| entry.map(|entry| entry.path())).collect();
    let mut paths = paths.map_err(ReportError::io("list", folder))?;
    paths.sort();
    Ok(paths)
}

fn check_names(directory: &Path, record: &Record) -> Result<(), ReportError> {
    let names = [
        ("experiment", &record.experiment),
        ("scene", &record.scene),
        ("variant", &record.variant),
        ("preset", &record.preset),
    ];
    let fault = names.into_iter().find_map(|(field, name)| Some((field, name, folder_name_fault(name)?)));
    match fault {
        Some((field, value, reason)) => {
            Err(ReportError::Name { path: directory.into(), field, value: value.clone(), reason })
        }
        None => Ok(()),
    }
}

fn parse_records(path: &Path, text: &str) -> Result<Vec<Record>, ReportError> {
    let values: Vec<Value> = serde_json::from_str(text)
        .map_err(|error| ReportError::Syntax { path: path.into(), reason: error.to_string() })?;
    let parse = |(index, value): (usize, Value)| {
        serde_json::from_value(value.clone()).map_err(|error: serde_json::Error| {
            let (field, reason) = offending_field(&value).unwrap_or_else(|| ("record".into(), error.to_string()));
            ReportError::Field { path: path.into(), index, field, reason }
        })
    };
    values.into_iter().enumerate().map(parse).collect()
}

/// The first key of a default record that `value` lacks, or whose value does not fit; and what was expected.
fn offending_field(value: &Value) -> Option<(String, String)> {
    let given = value.as_object()?;
    let default = serde_json::to_value(Record::default()).ok()?;
    let missing = |key: &&String| !given.contains_key(*key) && default.get(*key).is_some_and(|value| !value.is_null());
    if let Some(key) = default.as_object()?.keys().find(missing) {
        return Some((key.clone(), "is missing".into()));
    }
    for (key, found) in given {
        let mut probe = default.clone();
        probe[key] = found.clone();
        if let Err(error) = serde_json::from_value::<Record>(probe) {
            return Some((key.clone(), error.to_string()));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::thread;

    use infonerf_metrics::Values;

    use super::*;

    fn psnr(value: f64) -> Values {
        [("psnr".to_owned(), Some(value))].into_iter().collect()
    }

    fn record(scene: &str, variant: &str, seed: u64) -> Record {
        Record {
            experiment: "e".into(),
            scene: scene.into(),
            variant: variant.into(),
            seed,
            preset: "fast".into(),
            metrics: psnr(18.123_456_789_012_345),
            ..Record::default()
        }
    }

    #[test]
    fn saving_again_replaces_in_place() {
        let directory = tempfile::tempdir().unwrap();
        save_record(directory.path(), &record("lego", "nerf", 0)).unwrap();
        save_record(directory.path(), &record("lego", "infonerf", 0)).unwrap();
        let better = Record { metrics: psnr(20.0), ..record("lego", "nerf", 0) };
        let records = save_record(directory.path(), &better).unwrap();
        assert_eq!(records, [better, record("lego", "infonerf", 0)]);
        assert_eq!(read_records(&directory.path().join(LIST)).unwrap(), records);
    }

    #[test]
    fn another_preset_is_another_record_and_deleted_runs_stay_listed() {
        let directory = tempfile::tempdir().unwrap();
        save_record(directory.path(), &record("lego", "nerf", 0)).unwrap();
        fs::remove_dir_all(directory.path().join("lego")).unwrap();
        let paper = Record { preset: "paper".into(), ..record("lego", "nerf", 0) };
        assert_eq!(save_record(directory.path(), &paper).unwrap().len(), 2);
    }

    #[test]
    fn many_writers_lose_nothing() {
        let directory = tempfile::tempdir().unwrap();
        thread::scope(|scope| {
            for seed in 0..8 {
                let path = directory.path();
                scope.spawn(move || {
                    for variant in ["a", "b", "c"] {
                        save_record(path, &record("lego", variant, seed)).unwrap();
                    }
                });
            }
        });
        assert_eq!(read_records(&directory.path().join(LIST)).unwrap().len(), 24);
        let hidden = fs::read_dir(directory.path())
            .unwrap()
            .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
        assert_eq!(hidden.count(), 0);
    }

    #[test]
    fn what_json_cannot_hold_is_null_with_a_note() {
        let directory = tempfile::tempdir().unwrap();
        let perfect = Record { metrics: psnr(f64::INFINITY), ..record("lego", "nerf", 0) };
        let saved = &save_record(directory.path(), &perfect).unwrap()[0];
        assert_eq!((saved.metrics["psnr"], saved.notes.len()), (None, 1));
        let timeless = Record { train_seconds: f64::NAN, ..record("lego", "nerf", 0) };
        let error = save_record(directory.path(), &timeless).unwrap_err().to_string();
        assert!(error.contains("field `train_seconds`: expected a finite number"), "{error}");
    }

    #[test]
    fn errors_name_the_file_and_the_field() {
        let path = Path::new("runs/e/results.json");
        let mut value = serde_json::to_value([record("lego", "nerf", 0)]).unwrap();
        value[0]["psnr"] = "high".into();
        let error = parse_records(path, &value.to_string()).unwrap_err().to_string();
        assert!(
            error.starts_with("runs/e/results.json: record 0: field `psnr`: psnr: invalid type: string \"high\""),
            "{error}"
        );
        value[0]["psnr"] = Value::Null;
        value[0].as_object_mut().unwrap().remove("device");
        let error = parse_records(path, &value.to_string()).unwrap_err().to_string();
        assert_eq!(error, "runs/e/results.json: record 0: field `device`: is missing");
        let error = parse_records(path, "[{").unwrap_err().to_string();
        assert!(error.starts_with("runs/e/results.json: not a list of records: EOF"), "{error}");
    }

    #[test]
    fn names_stay_inside_the_experiment() {
        for name in ["..", "a/b", "", "a:b"] {
            let error = save_record(Path::new("nowhere"), &record(name, "nerf", 0)).unwrap_err();
            assert!(matches!(error, ReportError::Name { field: "scene", .. }), "{name:?}");
        }
    }
}
