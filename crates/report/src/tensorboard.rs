//! Training curves for TensorBoard: event files with every scalar of a `metrics.jsonl`.
//!
//! A file is a sequence of records, each `length (u64), masked CRC of length, data, masked CRC of data`, little-endian
//! ([TFRecord](https://www.tensorflow.org/tutorials/load_data/tfrecord#tfrecords_format_details)). The data is an `Event`
//! in the encoding of Protocol Buffers, of which scalars need five fields
//! ([event.proto](https://github.com/tensorflow/tensorboard/blob/master/tensorboard/compat/proto/event.proto)).

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;
use walkdir::WalkDir;

use crate::error::ReportError;
use crate::events::EVENTS_FILE;
use crate::files::write_atomically;

/// Name of the event file next to a log: TensorBoard looks for `tfevents`.
const EVENTS: &str = "events.out.tfevents.infonerf";

/// Writes an event file next to each `metrics.jsonl` in `folder` or below, replaces an earlier one, and returns the paths of
/// the files. Point TensorBoard's `--logdir` at `folder`.
///
/// Lines that are not JSON are left out, such as the last one of a run that was killed.
///
/// # Errors
/// If there is no `metrics.jsonl`, or a file cannot be read or written.
pub fn write_tensorboard(folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
    let entries: Result<Vec<_>, _> = WalkDir::new(folder).follow_links(true).sort_by_file_name().into_iter().collect();
    let mut entries = entries.map_err(ReportError::io("list", folder))?;
    entries.retain(|entry| entry.file_name() == EVENTS_FILE);
    if entries.is_empty() {
        return Err(ReportError::io("read", folder)(format!("no {EVENTS_FILE} in it or below")));
    }
    let write = |log: &Path| {
        let text = fs::read(log).map_err(ReportError::io("read", log))?;
        let written = fs::metadata(log).and_then(|log| log.modified()).map_err(ReportError::io("read", log))?;
        let events = log.with_file_name(EVENTS);
        write_atomically(&events, &tensorboard_events(&String::from_utf8_lossy(&text), written))?;
        Ok(events)
    };
    entries.iter().map(|entry| write(entry.path())).collect()
}

/// Makes the event file of a `metrics.jsonl` whose last line was written at `end`.
///
/// Each line becomes an event at its step. Each of its numbers becomes a scalar, called `train/KEY` in training steps
/// and `EVENT/KEY` in others; a nested one is called like `train/losses/rgb`. The time of an event is `end` minus the seconds
/// of training that remained, so that TensorBoard's axis of relative time shows seconds of training.
pub fn tensorboard_events(text: &str, end: SystemTime) -> Vec<u8> {
    let lines: Vec<Value> = text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let seconds = |line: &Value| line["seconds"].as_f64();
    let last = lines.iter().rev().find_map(seconds).unwrap_or(0.0);
    let start = end.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs_f64() - last;
    let mut file = Vec::new();
    let mut time = start;
    push(&mut file, &[double(1, start), bytes(3, b"brain.Event:2")].concat());
    for line in &lines {
        let (Some(name), Some(step)) = (line["event"].as_str(), line["step"].as_u64()) else { continue };
        time = seconds(line).map_or(time, |seconds| start + seconds);
        let mut summary = Vec::new();
        scalars(line, if name == "step" { "train" } else { name }, &mut summary);
        push(&mut file, &[double(1, time), tag(2, 0), varint(step), bytes(5, &summary)].concat());
    }
    file
}

/// Adds a `Summary.Value` for each number in `value`, the field `name`.
fn scalars(value: &Value, name: &str, summary: &mut Vec<u8>) {
    match value {
        Value::Object(fields) => {
            for (key, value) in fields.iter().filter(|(key, _)| *key != "step") {
                scalars(value, &format!("{name}/{key}"), summary);
            }
        }
        Value::Number(number) => {
            let value = (number.as_f64().unwrap_or(f64::NAN) as f32).to_le_bytes();
            summary.extend(bytes(1, &[bytes(1, name.as_bytes()), tag(2, 5), value.to_vec()].concat()));
        }
        _ => {}
    }
}

fn push(file: &mut Vec<u8>, data: &[u8]) {
    let length = (data.len() as u64).to_le_bytes();
    for part in [&length[..], data] {
        file.extend(part);
        // TFRecord rotates each CRC and adds a constant, since a CRC over data that contains CRCs would be weak.
        file.extend(crc32c::crc32c(part).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes());
    }
}

/// Encodes the head of a field: its number and the kind of its value.
fn tag(field: u64, kind: u64) -> Vec<u8> {
    varint(field << 3 | kind)
}

/// Encodes an integer with seven bits in each byte, the lowest first.
fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

fn double(field: u64, value: f64) -> Vec<u8> {
    [tag(field, 1), value.to_le_bytes().to_vec()].concat()
}

fn bytes(field: u64, value: &[u8]) -> Vec<u8> {
    [tag(field, 2), varint(value.len() as u64), value.to_vec()].concat()
}
