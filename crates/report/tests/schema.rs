//! The JSON schema of `results.json` describes every key of a record, and requires the keys that reading needs.

use std::collections::BTreeSet;

use infonerf_metrics::METRICS;
use infonerf_report::{CameraErrors, Record, Setting};
use serde_json::{Map, Value};

const RESULTS_SCHEMA: &str = include_str!("../results.schema.json");

/// Returns a record in which every field has a value.
fn full() -> Record {
    Record {
        setting: Some(Setting { variant: "infonerf".into(), ..Setting::default() }),
        preset: "fast".into(),
        train_views: vec![26],
        train_files: vec!["train/r_26.png".into()],
        test_files: vec!["test/r_0.png".into()],
        image_size: [200, 200],
        metrics: METRICS.iter().map(|metric| (metric.key().to_owned(), Some(0.5))).collect(),
        ray_entropy_bits: Some(1.5),
        information_gain: Some(0.5),
        cameras: Some(CameraErrors::default()),
        peak_rss_bytes: Some(1 << 30),
        train_seconds: 0.5,
        render_seconds_per_image: 0.5,
        notes: vec!["note".into()],
        ..Record::default()
    }
}

fn object(value: &Value) -> &Map<String, Value> {
    value.as_object().unwrap()
}

fn keys(value: &Value) -> Vec<&String> {
    object(value).keys().collect()
}

fn allows(property: &Value, value: &Value) -> bool {
    let types = match &property["type"] {
        Value::Array(types) => types.clone(),
        one => vec![one.clone()],
    };
    types.iter().any(|kind| match kind.as_str().unwrap() {
        "string" => value.is_string(),
        "integer" => value.is_u64(),
        "number" => value.is_number(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        "array" => value.as_array().is_some_and(|list| list.iter().all(|item| allows(&property["items"], item))),
        "object" if property.get("additionalProperties").is_some() => value.is_object(),
        "object" => {
            keys(value) == keys(&property["properties"])
                && object(value).iter().all(|(key, value)| allows(&property["properties"][key], value))
        }
        other => panic!("type {other}"),
    })
}

#[test]
fn every_key_has_a_description_and_its_type() {
    let schema: Value = serde_json::from_str(RESULTS_SCHEMA).unwrap();
    assert_eq!(schema["type"], "array");
    let properties = &schema["items"]["properties"];
    let record = serde_json::to_value(full()).unwrap();
    let [described, written] = [properties, &record].map(|object| keys(object).into_iter().collect::<BTreeSet<_>>());
    assert_eq!(described, written, "results.schema.json and the record");
    for (key, value) in object(&record) {
        assert!(allows(&properties[key], value), "{key}: {value}");
        assert!(properties[key]["description"].as_str().is_some_and(|text| text.ends_with('.')), "{key}");
    }
    for (key, value) in object(&serde_json::to_value(Record::default()).unwrap()) {
        assert!(allows(&properties[key], value), "{key}: {value}");
    }
    for metric in METRICS {
        let text = properties[metric.key()]["description"].as_str().unwrap().to_lowercase();
        assert_eq!(text, format!("{}.", metric.definition).to_lowercase(), "{}", metric.key());
    }
}

#[test]
fn required_keys_are_those_that_reading_needs() {
    let schema: Value = serde_json::from_str(RESULTS_SCHEMA).unwrap();
    let required: Vec<&str> =
        schema["items"]["required"].as_array().unwrap().iter().map(|key| key.as_str().unwrap()).collect();
    let record = serde_json::to_value(full()).unwrap();
    assert_eq!(serde_json::from_value::<Record>(record.clone()).unwrap(), full());
    let unmeasured = Record { metrics: [("lpips_alex".to_owned(), None)].into_iter().collect(), ..full() };
    let text = serde_json::to_string(&unmeasured).unwrap();
    assert!(text.contains("\"lpips_alex\":null"), "{text}");
    assert_eq!(serde_json::from_str::<Record>(&text).unwrap(), unmeasured);
    for key in keys(&record) {
        let mut without = record.clone();
        without.as_object_mut().unwrap().remove(key);
        let read = serde_json::from_value::<Record>(without);
        assert_eq!(read.is_err(), required.contains(&key.as_str()), "{key}");
    }
}
