//! Sweeps: every combination once, whatever happens on the way.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant, SystemTime};

use crate::common::{Invocation, SWEEP, Workplace, records, text, without_times};
use serde_json::Value;

const RUNS: usize = 8;
const FOLDER: &str = "sweep-fast-losses";

fn sweep(place: &Workplace, out: &str) -> Invocation {
    place.tiny(SWEEP).args(&["--out", out])
}

fn folder(place: &Workplace, out: &str) -> PathBuf {
    place.path(out).join(FOLDER)
}

/// The table without its columns of times and memory.
fn table(folder: &Path) -> String {
    let timed = |heading: &str| ["Training", "Render", "memory"].iter().any(|part| heading.contains(part));
    let text = fs::read_to_string(folder.join("table.csv")).unwrap();
    let lines = || text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect::<Vec<_>>());
    let headings = lines().next().unwrap();
    let kept = |cells: Vec<&str>| {
        let cells = cells.into_iter().zip(&headings).filter(|(_, heading)| !timed(heading));
        cells.map(|(cell, _)| cell).collect::<Vec<_>>().join(",")
    };
    lines().map(kept).collect::<Vec<_>>().join("\n")
}

/// When each run finished.
fn finished(folder: &Path) -> Vec<(PathBuf, SystemTime)> {
    let mut found = Vec::new();
    for variant in fs::read_dir(folder.join("knot")).into_iter().flatten().flatten() {
        for seed in fs::read_dir(variant.path()).unwrap().flatten() {
            let record = seed.path().join("record-fast.json");
            if let Ok(time) = fs::metadata(&record).and_then(|metadata| metadata.modified()) {
                found.push((record, time));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn every_combination_is_run_once() {
    let place = Workplace::new();
    let said = text(&sweep(&place, "runs").succeeds().stdout);
    assert!(said.contains("(8 runs)"), "{said}");
    let folder = folder(&place, "runs");
    let list = records(&folder);
    assert_eq!(list.len(), RUNS);
    let variants: BTreeSet<&str> = list.iter().map(|record| record["variant"].as_str().unwrap()).collect();
    let expected = ["0_loss.kl.weight_0", "0_loss.kl.weight_1e-4", "1e-3_loss.kl.weight_0", "1e-3_loss.kl.weight_1e-4"]
        .map(|rest| format!("infonerf_loss.entropy.weight_{rest}"));
    assert_eq!(variants, expected.iter().map(String::as_str).collect());
    for file in ["table.md", "table.csv", "report.html", "plots/sweep-psnr-infonerf.svg"] {
        assert!(folder.join(file).is_file(), "{file}");
    }
    assert!(fs::read_to_string(folder.join("table.md")).unwrap().contains('±'));

    let lines: Vec<Value> = fs::read_to_string(folder.join("manifest.jsonl"))
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), RUNS);
    let config: toml::Table = lines[3]["config"].as_str().unwrap().parse().unwrap();
    assert_eq!(config["config"]["loss"]["kl"]["weight"].as_float().map(|weight| weight as f32), Some(1e-4));
    assert_eq!((&lines[3]["seed"], &lines[3]["source"]), (&1.into(), &"built-in scene knot".into()));

    // Again: nothing is left to do, and nothing changes.
    let before = (finished(&folder), table(&folder));
    let said = text(&sweep(&place, "runs").succeeds().stdout);
    assert!(said.contains("8 runs, 8 of them finished before"), "{said}");
    assert_eq!(before, (finished(&folder), table(&folder)));
}

#[test]
fn two_at_a_time_give_the_same_numbers() {
    let place = Workplace::new();
    sweep(&place, "one").succeeds();
    sweep(&place, "two").args("--jobs 2").succeeds();
    let list = |out| without_times(&records(&folder(&place, out)));
    assert_eq!(list("one"), list("two"));
    assert_eq!(table(&folder(&place, "one")), table(&folder(&place, "two")));
}

#[test]
fn an_experiment_runs_two_at_a_time() {
    let place = Workplace::new();
    let chosen = "exp fast-losses --scene knot --variant factored --variant infonerf";
    let run = |out: &str| place.tiny(chosen).args(&["--out", out]);
    run("one").succeeds();
    let said = text(&run("two").args("--jobs 2").succeeds().stdout);
    assert!(said.contains("the paper's losses improve on RGB alone"), "its claims are told: {said}");
    let list = |out| without_times(&records(&place.path(out).join("fast-losses")));
    assert_eq!(list("one"), list("two"));
    run("two").args("--jobs 2 --json").fails_with(&["--json", "--jobs"]);
}

/// The runs that are there are removed first, and once: also those of another config, and not those that were not asked for.
#[test]
fn an_experiment_is_overwritten_in_processes_of_their_own() {
    let place = Workplace::new();
    let exp =
        |steps: &str| place.tiny("exp fast-losses --scene knot --variant factored --jobs 2").args(&["--set", steps]);
    exp("train.iterations=3").args("--variant infonerf").succeeds();
    let listed = || finished(&place.path("runs/fast-losses"));
    let before = listed();
    exp("train.iterations=2").fails_with(&["config.toml", "another config"]);
    let said = text(&exp("train.iterations=2").args("--overwrite").succeeds().stdout);
    assert!(said.contains("(1 runs)"), "{said}");
    let after = listed();
    assert_eq!(after.len(), 2);
    let same = |name: &str| {
        let of = |(path, _): &&(PathBuf, SystemTime)| path.iter().any(|part| part == name);
        before.iter().find(of) == after.iter().find(of)
    };
    assert!(same("infonerf") && !same("factored"));
    let said = text(&exp("train.iterations=2").succeeds().stdout);
    assert!(said.contains("1 of them finished before"), "{said}");
}

/// Four by four weights of the paper's losses.
const WEIGHTS: &str = "sweep fast-losses --scene knot --variant infonerf --space paper";

#[test]
fn a_sweep_that_was_killed_goes_on() {
    let place = Workplace::new();
    let weights = |out: &str| place.tiny(WEIGHTS).args(&["--set", "eval.information_rays=0", "--out", out]);
    weights("unbroken").succeeds();
    let killed = folder(&place, "killed");
    let mut child = weights("killed").into_command().stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let patience = Instant::now();
    while finished(&killed).len() < 5 {
        assert!(patience.elapsed() < Duration::from_secs(60), "no five runs in a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = finished(&killed);
    assert!(before.len() < 16, "the sweep had ended before it was killed");
    // The process of the item that was running sees that it is alone.
    std::thread::sleep(Duration::from_secs(1));

    weights("killed").succeeds();
    let after = finished(&killed);
    assert_eq!(after.len(), 16);
    assert!(before.iter().all(|run| after.contains(run)), "a finished run was repeated");
    let list = |out| without_times(&records(&folder(&place, out)));
    assert_eq!(list("unbroken"), list("killed"));
    assert_eq!(table(&folder(&place, "unbroken")), table(&killed));
}

#[test]
fn a_run_that_takes_too_long_is_given_up_and_the_others_go_on() {
    let place = Workplace::new();
    let args = "sweep fast-losses --scene knot --variant factored --timeout 8s --grid train.iterations=3,100000000";
    let output = place.tiny_without("train.iterations", args).into_command().output().unwrap();
    let (said, complaint) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(1), "{said}\n{complaint}");
    assert!(
        complaint.contains("timed out after 8 s") && complaint.contains("1 of 2 runs are not finished"),
        "{complaint}"
    );
    assert_eq!(records(&folder(&place, "runs")).len(), 1);
}

/// Leaves a sweep's manifest below `out`, with none of its runs.
fn with_manifest_alone(place: &Workplace, out: &str) {
    sweep(place, out).succeeds();
    let (folder, kept) = (folder(place, out), place.path("kept.jsonl"));
    fs::rename(folder.join("manifest.jsonl"), &kept).unwrap();
    fs::remove_dir_all(&folder).unwrap();
    fs::create_dir_all(&folder).unwrap();
    fs::rename(kept, folder.join("manifest.jsonl")).unwrap();
}

#[test]
fn items_run_alone() {
    let place = Workplace::new();
    sweep(&place, "whole").succeeds();
    let manifest = "items/sweep-fast-losses/manifest.jsonl";
    with_manifest_alone(&place, "items");
    for item in (0..RUNS).rev() {
        place.run(&["sweep-item", manifest, &item.to_string()]).succeeds();
    }
    let said = text(&place.run(&["sweep-item", manifest, "5"]).succeeds().stdout);
    assert!(said.contains("finished before"), "{said}");
    place.run(&["sweep-item", manifest, "8"]).fails_with(&["manifest.jsonl", "item 8"]);
    place.run("sweep-item nothing.jsonl 0").fails_with(&["nothing.jsonl"]);
    // What is left to do is the table.
    let said = text(&sweep(&place, "items").succeeds().stdout);
    assert!(said.contains("8 runs, 8 of them finished before"), "{said}");
    let list = |out| without_times(&records(&folder(&place, out)));
    assert_eq!(list("whole"), list("items"));
}

#[test]
fn an_item_that_fails_is_reported_and_the_others_go_on() {
    let place = Workplace::new();
    // The scene has 100 views.
    let args = "sweep fast-losses --scene knot --variant factored \
                --grid scene.views={kind='ids',ids=[1]},{kind='ids',ids=[1000]}";
    let output = place.tiny(args).into_command().output().unwrap();
    let (said, complaint) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(1), "{said}\n{complaint}");
    assert!(complaint.contains("failed: ") && complaint.contains("1000"), "{complaint}");
    assert!(complaint.contains("1 of 2 runs are not finished"), "{complaint}");
    assert_eq!(records(&place.path("runs").join(FOLDER)).len(), 1);
}

#[test]
fn a_variant_that_the_grid_makes_into_another_is_left_out() {
    let place = Workplace::new();
    let file = "[variants.a]\n[variants.b.loss]\nentropy.weight = 0.5\n[variants.c.train]\nlr = 1e-3\n";
    fs::write(place.path("mine.toml"), file).unwrap();
    let sweep = place.tiny("sweep mine.toml --scene knot --grid loss.entropy.weight=0,1e-3");
    let said = text(&sweep.succeeds().stdout);
    assert!(said.contains("4 runs") && said.contains("variant b is left out"), "{said}");
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
        ("loss.entropy.weight=0,1,0", &["0 is given twice"]),
        ("loss.entropy.weight=1,1.0", &["loss.entropy.weight=1 ", "loss.entropy.weight=1.0", "the same run"]),
        ("loss.entropy.weight=0,high", &["loss.entropy.weight", "high"]),
        ("loss.entropy.weight=-1", &["loss.entropy.weight"]),
        ("train.precrop_steps=0.5", &["train.precrop_steps", "0.5"]),
        ("..=1", &["..=1"]),
    ] {
        grid(&format!("--grid {values}")).fails_with(parts);
    }
    grid("--grid train.lr=1e-3,1e-2 --grid train.lr=0.1").fails_with(&["--grid train.lr", "twice"]);
    grid("--grid train.lr=1e-3 --set train.lr=1e-2").fails_with(&["--set train.lr=1e-2", "--grid train.lr"]);
    grid("--grid train.lr=1e-3 --scene lego").fails_with(&["lego"]);
    grid("--grid train.lr=1e-3 --seed 1 --seed 0..2").fails_with(&["--seed 1", "twice"]);
    grid("").fails_with(&["--grid"]);
    grid("--grid train.lr=1e-3 --jobs 0").fails_with(&["--jobs"]);
    grid("--grid train.lr=1e-3 --seed 4..0").fails_with(&["4..0"]);
    grid("--grid train.lr=1e-3 --timeout 0").fails_with(&["--timeout"]);
    assert!(!place.path("runs").exists(), "nothing is written before the plan is whole");
}

#[test]
fn another_version_and_another_config() {
    let place = Workplace::new();
    with_manifest_alone(&place, "runs");
    let path = folder(&place, "runs").join("manifest.jsonl");
    let whole = fs::read_to_string(&path).unwrap();
    let name = path.to_str().unwrap();
    for (from, to) in [("\"version\":1", "\"version\":2"), ("\"program\":\"", "\"program\":\"0.0.")] {
        fs::write(&path, whole.replace(from, to)).unwrap();
        place.run(&["sweep-item", name, "0"]).fails_with(&["manifest.jsonl", "version"]);
        sweep(&place, "runs").fails_with(&["manifest.jsonl", "version"]);
    }
    for damaged in ["{}\n", "not JSON\n", "{\"version\":1"] {
        fs::write(&path, damaged).unwrap();
        place.run(&["sweep-item", name, "0"]).fails_with(&["manifest.jsonl"]);
    }
    fs::write(&path, whole.replace("seed\":0", "seed\":7")).unwrap();
    place.run(&["sweep-item", name, "0"]).fails_with(&["line 1", "seed"]);

    fs::write(&path, whole).unwrap();
    place.run(&["sweep-item", name, "0"]).succeeds();
    sweep(&place, "runs").args("--set train.iterations=4").fails_with(&["config.toml", "another config"]);
}
