//! `scripts/gpu-check` with a stand-in for the program: every step is recorded, also if some of them fail.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Stand-in for the program that has no CUDA, fails the stress rows, and writes results only of the comparison with the CPU.
const PROGRAM: &str = r#"#!/usr/bin/env bash
all="$*"
while (($#)); do
    case "$1" in
        --device) device="$2" ;;
        --out) out="$2" ;;
    esac
    shift
done
[[ "$device" == cuda ]] && { echo "error: --device cuda: no such device" >&2; exit 2; }
echo "$device: A \"GPU\"" >&2
case "$all" in
    *"bench agreement"*) mkdir -p "$out/agreement" && echo '{"rows": 3}' >"$out/agreement/results.json" ;;
    *"bench stress"*) exit 1 ;;
esac
"#;

#[test]
fn every_step_is_written_down() {
    let folder = tempfile::tempdir().unwrap();
    let bundle = folder.path().join("a bundle");
    fs::create_dir_all(bundle.join("bin")).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("scripts/gpu-check");
    fs::copy(script, bundle.join("gpu-check")).unwrap();
    let program = bundle.join("bin/infonerf-cuda-vulkan");
    fs::write(&program, PROGRAM).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
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
