//! The command line on a GPU, or on a software device in its place.
#![cfg(any(feature = "wgpu", feature = "vulkan", feature = "cuda"))]

use crate::common::{Workplace, records, text};

const DEVICE: &str = match (cfg!(feature = "cuda"), cfg!(feature = "vulkan")) {
    (true, _) => "cuda",
    (false, true) => "vulkan",
    (false, false) => "wgpu",
};

#[test]
fn an_experiment_on_the_gpu_ends_with_a_report() {
    let place = Workplace::new();
    let output = place.tiny(format!("exp fast-losses --device {DEVICE} --scene knot")).succeeds();
    let stderr = text(&output.stderr);
    assert!(stderr.lines().any(|line| line.starts_with(&format!("{DEVICE}: "))), "the adapter is named: {stderr}");
    let records = records(&place.path("runs/fast-losses"));
    assert_eq!(records.len(), 4);
    for record in records {
        assert_eq!(record["device"], DEVICE);
        assert!(record["psnr"].as_f64().unwrap() > 5.0, "{record}");
    }
    assert!(place.path("runs/fast-losses/report.html").exists());
}

#[test]
fn the_gpu_agrees_with_the_cpu() {
    let place = Workplace::new();
    place.run(format!("bench agreement --device {DEVICE}")).succeeds_with(&["agree with flex"]);
}

#[test]
#[cfg(not(feature = "cuda"))]
fn no_adapter_is_a_clear_error() {
    let place = Workplace::new();
    let mut command = place.tiny(format!("exp fast-losses --device {DEVICE} --scene knot")).into_command();
    for drivers in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "__EGL_VENDOR_LIBRARY_FILENAMES"] {
        command.env(drivers, "/nowhere");
    }
    let output = command.output().unwrap();
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(&format!("--device {DEVICE}: no such device")), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
}
