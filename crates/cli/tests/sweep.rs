//! Sweeps: every combination once, whatever happens on the way.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, SystemTime};

use crate::common::{EXP, Invocation, SWEEP, Workplace, assert_has, records, text, wait_until, without_times};

const RUNS: usize = 8;
const FOLDER: &str = "sweep-fast-losses";

fn sweep(place: &Workplace, out: &str) -> Invocation {
    place.tiny(SWEEP).args(format!("--out {out}"))
}

fn folder(place: &Workplace, out: &str) -> PathBuf {
    place.path(out).join(FOLDER)
}

/// Returns the record of each finished run with its time of modification.
fn finished(folder: &Path) -> BTreeSet<(PathBuf, SystemTime)> {
    let variants = fs::read_dir(folder.join("knot")).into_iter().flatten().flatten();
    let runs = variants.flat_map(|variant| fs::read_dir(variant.path()).unwrap().flatten());
    let recorded = runs.filter_map(|run| {
        let record = run.path().join("record-fast.json");
        let time = fs::metadata(&record).and_then(|metadata| metadata.modified()).ok()?;
        Some((record, time))
    });
    recorded.collect()
}

/// Items of the manifest give the same numbers alone, in any order, and two at a time.
#[test]
fn every_combination_is_run_once() {
    let place = Workplace::new();
    sweep(&place, "runs").succeeds_with(&["(8 runs)"]);
    let whole = folder(&place, "runs");
    let list = records(&whole);
    assert_eq!(list.len(), RUNS);
    let variants: BTreeSet<&str> = list.iter().map(|record| record["variant"].as_str().unwrap()).collect();
    let expected = ["0_loss.kl.weight_0", "0_loss.kl.weight_1e-4", "1e-3_loss.kl.weight_0", "1e-3_loss.kl.weight_1e-4"]
        .map(|rest| format!("infonerf_loss.entropy.weight_{rest}"));
    assert_eq!(variants, expected.iter().map(String::as_str).collect());
    for file in ["table.md", "table.tex", "table.csv", "report.html", "plots/sweep-psnr-infonerf.svg"] {
        assert!(whole.join(file).is_file(), "{file}");
    }
    assert!(fs::read_to_string(whole.join("table.md")).unwrap().contains('±'));

    // The same command has nothing left to do, and changes nothing.
    let before = finished(&whole);
    sweep(&place, "runs").succeeds_with(&["8 runs, 8 finished before"]);
    assert_eq!(before, finished(&whole));

    let numbers = |out| without_times(&records(&folder(&place, out)));
    sweep(&place, "two").args("--jobs 2").succeeds();
    assert_eq!(numbers("runs"), numbers("two"));

    let alone = folder(&place, "items").join("manifest.jsonl");
    fs::create_dir_all(folder(&place, "items")).unwrap();
    fs::copy(whole.join("manifest.jsonl"), &alone).unwrap();
    let item = |item: usize| place.run("sweep-item").arg(alone.to_str().unwrap()).arg(&item.to_string());
    (0..RUNS).rev().for_each(|index| drop(item(index).succeeds()));
    item(5).succeeds_with(&["finished before"]);
    item(8).fails_with(&["manifest.jsonl", "item 8"]);
    place.run("sweep-item nothing.jsonl 0").fails_with(&["nothing.jsonl"]);
    // Only the table is left to be written.
    sweep(&place, "items").succeeds_with(&["8 runs, 8 finished before"]);
    assert_eq!(numbers("runs"), numbers("items"));

    let text = fs::read_to_string(&alone).unwrap();
    fs::write(&alone, text.replace("\"program\":\"", "\"program\":\"0.0.")).unwrap();
    item(0).fails_with(&["manifest.jsonl", "version"]);
    sweep(&place, "items").fails_with(&["manifest.jsonl", "version"]);
    for damaged in ["{}\n", "not JSON\n", "{\"program\""] {
        fs::write(&alone, damaged).unwrap();
        item(0).fails_with(&["manifest.jsonl"]);
    }
    sweep(&place, "runs").args("--set train.rays=17").fails_with(&["config.toml", "another config"]);
}

/// Existing runs are removed first and once, also those of another config, but not those that are not selected.
#[test]
fn an_experiment_is_overwritten_in_processes_of_their_own() {
    let place = Workplace::new();
    let exp = |steps: &str| place.tiny(EXP).args("--jobs 2").args(format!("--set {steps}"));
    // The experiment's claims are printed.
    exp("train.iterations=3").args("--variant infonerf").succeeds_with(&["the paper's losses improve on RGB alone"]);
    exp("train.iterations=3").args("--json").fails_with(&["--json", "--jobs"]);
    let listed = || finished(&place.path("runs/fast-losses"));
    let before = listed();
    exp("train.iterations=2").fails_with(&["config.toml", "another config"]);
    exp("train.iterations=2").args("--overwrite").succeeds_with(&["(1 run)"]);
    let after = listed();
    assert_eq!(after.len(), 2);
    let same = |name: &str| {
        let of = |(path, _): &&(PathBuf, SystemTime)| path.iter().any(|part| part == name);
        before.iter().find(of) == after.iter().find(of)
    };
    assert!(same("infonerf") && !same("factored"));
    exp("train.iterations=2").succeeds_with(&["1 finished before"]);
}

/// A sweep of four by four weights of the paper's losses is killed.
#[test]
fn a_sweep_that_was_killed_goes_on() {
    let place = Workplace::new();
    let sweep = "sweep fast-losses --scene knot --variant infonerf --space paper --set eval.information_rays=0";
    let weights = |out: &str| place.tiny(sweep).args(format!("--out {out}"));
    weights("unbroken").succeeds();
    let killed = folder(&place, "killed");
    let mut child = weights("killed").into_command().stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    wait_until("five runs", || finished(&killed).len() >= 5);
    child.kill().unwrap();
    child.wait().unwrap();
    let before = finished(&killed);
    assert!(before.len() < 16, "the sweep had ended before it was killed");
    // The process of the item that was running ends, since its parent has ended.
    std::thread::sleep(Duration::from_secs(1));

    weights("killed").succeeds();
    let after = finished(&killed);
    assert_eq!(after.len(), 16);
    assert!(before.iter().all(|run| after.contains(run)), "a finished run was repeated");
    let list = |out| without_times(&records(&folder(&place, out)));
    assert_eq!(list("unbroken"), list("killed"));
}

/// A view 1000 does not exist in the scene of 100 views, and 1e8 steps take too long.
#[test]
fn a_run_that_fails_or_takes_too_long_is_reported_and_the_others_go_on() {
    let place = Workplace::new();
    let views = "--grid scene.views={kind='ids',ids=[1]},{kind='ids',ids=[1000]} --set train.iterations=3 --out views";
    let steps = "--grid train.iterations=3,100000000 --timeout 8s --out steps";
    for (args, out, part) in [(views, "views", "1000"), (steps, "steps", "timed out after 8 s; saved at step")] {
        let sweep = place.tiny_without("train.iterations", "sweep fast-losses --scene knot --variant factored");
        let output = sweep.args(args).into_command().output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        assert_has(&text(&output.stderr), &["failed: ", part, "(1 of 2 runs)"]);
        assert_eq!(records(&folder(&place, out)).len(), 1);
    }
}

#[test]
fn bad_grids() {
    let place = Workplace::new();
    let grid = |args: &str| place.tiny("sweep fast-losses --scene knot").args(args);
    for (values, parts) in [
        ("loss.entropi.weight=0,1", &["entropi"][..]),
        ("loss.entropy.weight", &["loss.entropy.weight", "="]),
        ("loss.entropy.weight=", &["loss.entropy.weight", "empty"]),
        ("loss.entropy.weight=0,,1", &["empty"]),
        ("field.resolutions=[4],", &["empty"]),
        ("field.resolutions=[4", &["--grid field.resolutions=[4"]),
        ("train.unseen=sphere,\"dataset\"", &["--grid train.unseen"]),
        ("loss.entropy.weight=0,1,0.0", &["expected different values, found 0 and 0.0"]),
        ("train.lr=1e-3,0.001", &["found 1e-3 and 0.001"]),
        ("loss.entropy.weight=0,high", &["loss.entropy.weight", "high"]),
        ("loss.entropy.weight=-1", &["loss.entropy.weight"]),
        ("train.precrop_steps=0.5", &["train.precrop_steps", "0.5"]),
        ("..=1", &["..=1"]),
    ] {
        grid(&format!("--grid {values}")).fails_with(parts);
    }
    grid("--grid train.lr=1e-3,1e-2 --grid train.lr=0.1").fails_with(&["--grid train.lr", "twice"]);
    grid("--grid loss={} --grid loss.kl.weight=1").fails_with(&["--grid loss.kl.weight: contradicts --grid loss"]);
    grid("--grid train.lr=1e-3 --set train.lr=1e-2").fails_with(&["--set train.lr=1e-2", "--grid train.lr"]);
    grid("--grid train.lr=1e-3 --seed 1 --seed 0..2").fails_with(&["--seed 1", "twice"]);
    grid("").fails_with(&["--grid"]);
    grid("--grid train.lr=1e-3 --seed 4..0").fails_with(&["4..0"]);
    assert!(!place.path("runs").exists(), "nothing is written before the plan is whole");
}
