//! Event files for TensorBoard. `tensorboard/check.py` compares them with the log through TensorBoard's own reader.

use std::fs;
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use infonerf_report::{tensorboard_events, write_tensorboard};

const LOG: &str = include_str!("tensorboard/metrics.jsonl");
const NAME: &str = "events.out.tfevents.infonerf";

#[test]
fn bytes_are_those_that_tensorboard_read() {
    let written = tensorboard_events(LOG, UNIX_EPOCH + Duration::from_secs(1_700_000_000));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tensorboard").join(NAME);
    if std::env::var_os("INFONERF_STORE").is_some() {
        fs::write(&path, &written).unwrap();
    }
    assert!(written == fs::read(&path).unwrap(), "{}: other bytes: see check.py", path.display());
}

#[test]
fn every_log_below_a_folder_has_an_event_file_next_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let error = write_tensorboard(folder.path()).unwrap_err().to_string();
    assert!(error.contains("no metrics.jsonl"), "{error}");
    let runs = ["knot/nerf/seed0", "knot/nerf/seed1/member0"].map(|run| folder.path().join(run));
    for run in &runs {
        fs::create_dir_all(run).unwrap();
        fs::write(run.join("metrics.jsonl"), LOG).unwrap();
    }
    let written = write_tensorboard(folder.path()).unwrap();
    assert_eq!(written, runs.map(|run| run.join(NAME)));
    let first = fs::read(&written[0]).unwrap();
    assert_eq!(write_tensorboard(folder.path()).unwrap(), written);
    assert_eq!(fs::read(&written[0]).unwrap(), first, "the same again");
    let error = write_tensorboard(&folder.path().join("nothing")).unwrap_err().to_string();
    assert!(error.contains("nothing: cannot list"), "{error}");
}
