//! The Python package and its notebook with the program that was built: `python/tests`, run by `$PYTHON`, else `python3`.

use std::env;
use std::io::{self, Write};
use std::path::Path;
use std::process::Command;

/// Prints what was not tested and why, in spite of the capture of the test's output.
fn not_run(what: &str) {
    io::stderr().write_all(format!("NOT RUN: Python: {what}\n").as_bytes()).unwrap();
}

#[test]
fn the_package_runs_the_program_and_reads_its_results() {
    let python = env::var_os("PYTHON").unwrap_or_else(|| "python3".into());
    let recent = ["-c", "import sys; sys.exit(sys.version_info < (3, 9))"];
    match Command::new(&python).args(recent).status() {
        Ok(status) if status.success() => {}
        Ok(_) => return not_run("expected version 3.9 or newer"),
        Err(error) => return not_run(&format!("{}: {error}", python.display())),
    }
    let output = Command::new(&python)
        .args(["-m", "unittest", "discover", "--start-directory", "tests", "--verbose"])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../python"))
        .env("INFONERF_PROGRAM", env!("CARGO_BIN_EXE_infonerf"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env_remove("INFONERF_WEIGHTS")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    assert!(text.contains("\nRan 11 tests"), "{text}");
    text.lines().filter(|line| line.contains(" skipped '") && line.contains("not installed")).for_each(not_run);
}
