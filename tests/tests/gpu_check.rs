//! `scripts/gpu-check` with a stand-in for the program: every step is recorded, also if some of them fail.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

#[test]
fn every_step_is_written_down() {
    let folder = tempfile::tempdir().unwrap();
    let bundle = folder.path().join("a bundle");
    fs::create_dir_all(bundle.join("bin")).unwrap();
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    fs::copy(own.join("../scripts/gpu-check"), bundle.join("gpu-check")).unwrap();
    fs::copy(own.join("fixtures/gpu_program"), bundle.join("bin/infonerf-cuda-vulkan")).unwrap();
    let out = bundle.join("gpu-results");

    // From within its own folder, where its name is taken.
    let mut command = Command::new("./gpu-check");
    let output = command.args(["--small", "--minutes", "5"]).current_dir(&bundle).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "a step failed: {output:?}");
    let json: Value = serde_json::from_str(&fs::read_to_string(out.join("gpu.json")).unwrap()).unwrap();
    assert_eq!((&json["device"], &json["adapter"]), (&"vulkan".into(), &"A GPU".into()));
    let steps = json["steps"].as_array().unwrap();
    let step = |name: &str| steps.iter().find(|step| step["name"] == name).unwrap_or_else(|| panic!("{name}"));
    assert_eq!(step("agreement with the CPU")["results"]["rows"], 3);
    assert_eq!(step("stress")["status"], 1);
    assert_eq!((&step("frames")["status"], &step("frames")["results"]), (&0.into(), &Value::Null));
    assert_eq!(step("a released run")["status"], 0);
    let report = fs::read_to_string(out.join("report.md")).unwrap();
    assert!(steps.iter().all(|step| report.contains(&format!("## {}\n", step["name"].as_str().unwrap()))), "{report}");
}
