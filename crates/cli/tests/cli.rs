//! The program as a person uses it, with tiny settings.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::process::Stdio;

use crate::common::{
    EXP, Invocation, Workplace, assert_has, events, files, records, text, wait_for, wait_until, without_times,
};
use infonerf_metrics::METRICS;
use serde_json::{Value, json};

/// Returns the keys of a record, in order.
fn keys() -> Vec<&'static str> {
    let before = "experiment scene variant seed preset device train_views test_views evaluation image_size iterations \
                  train_seconds render_seconds_per_image samples_total samples_evaluated";
    let after = "ray_entropy_bits information_gain peak_rss_bytes collapsed notes";
    let metrics = METRICS.iter().map(|metric| metric.key());
    before.split(' ').chain(metrics).chain(after.split(' ')).collect()
}

/// Returns the number of characters of the longest rule of a table.
fn rule(stdout: &str) -> usize {
    stdout.lines().filter(|line| line.starts_with('─')).map(|line| line.chars().count()).max().unwrap()
}

#[test]
fn an_experiment_leaves_everything_behind() {
    let place = Workplace::new();
    let parts = ["no --data given", "knot/factored/seed0", "knot/infonerf+/seed0", "PSNR", "report.html"];
    let stdout = place.tiny("exp fast-losses --scene knot").succeeds_with(&parts);
    assert!(rule(&stdout) <= 100 && stdout.contains("more columns in report.html"), "{stdout}");

    let experiment = place.path("runs/fast-losses");
    let records = records(&experiment);
    assert_eq!(records.len(), 4);
    for record in &records {
        let found: BTreeSet<&str> = record.as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(found, keys().into_iter().collect());
        let expected = json!({
            "scene": "knot", "preset": "fast", "device": "flex", "iterations": 3, "image_size": [24, 24],
            "train_views": [26, 86, 2, 55],
        });
        expected.as_object().unwrap().iter().for_each(|(key, value)| assert_eq!(record[key], *value, "{key}"));
        assert_eq!(record["test_views"]["protocol"], "first-2");
        assert_eq!(record["test_views"]["count"], 2);
        for key in ["psnr", "ssim", "silhouette_iou", "ray_entropy_bits", "information_gain", "train_seconds"] {
            assert!(record[key].is_f64(), "{key}: {}", record[key]);
        }
        for null in keys().into_iter().filter(|key| record[*key].is_null()) {
            let notes = record["notes"].to_string();
            assert!(notes.contains(null), "no note says why {null} is null: {notes}");
        }
    }
    // The order of the keys is part of the format.
    let raw = place.read("runs/fast-losses/results.json");
    let places: Vec<usize> = keys().iter().map(|key| raw.find(&format!("\"{key}\":")).unwrap()).collect();
    assert!(places.is_sorted(), "{raw}");

    for variant in ["factored", "infonerf", "infonerf+"] {
        let run = experiment.join(format!("knot/{variant}/seed0"));
        assert!(files(&run.join("checkpoint")).contains("manifest.json"));
        let config: toml::Table = fs::read_to_string(run.join("config.toml")).unwrap().parse().unwrap();
        assert_eq!(config["config"]["train"]["iterations"].as_integer(), Some(3));
        assert_eq!(events(&run).len(), 3);
        assert!(fs::read_to_string(run.join("viewer.html")).unwrap().contains(&format!("knot/{variant}/seed0")));
        for kind in ["test", "depth"] {
            assert_eq!(files(&run.join(kind)), BTreeSet::from(["000.png".to_owned(), "001.png".to_owned()]));
            let picture = image::open(run.join(kind).join("000.png")).unwrap();
            assert_eq!((picture.width(), picture.height()), (24, 24));
        }
    }
    let html = place.read("runs/fast-losses/report.html");
    let page = "src=\"knot/infonerf%2B/seed0/viewer.html\"";
    assert_has(&html, &["infonerf", "PSNR", "data:image/png;base64,", "<svg", page]);
    for outside in ["src=\"http", "href=\"http", "<script src", "@import"] {
        assert!(!html.contains(outside), "the report needs {outside}");
    }
}

#[test]
fn a_seed_and_a_saved_config_give_the_same_numbers() {
    let place = Workplace::new();
    let exp = "exp fast-losses --scene knot";
    place.tiny(exp).succeeds();
    place.tiny(exp).args("--out again").succeeds();
    let first = records(&place.path("runs/fast-losses"));
    assert_eq!(without_times(&first), without_times(&records(&place.path("again/fast-losses"))));

    let saved = "runs/fast-losses/knot/infonerf/seed0/config.toml";
    place.run(format!("exp {saved} --out saved")).succeeds();
    let repeated = records(&place.path("saved/fast-losses"));
    let infonerf: Vec<Value> = first.into_iter().filter(|record| record["variant"] == "infonerf").collect();
    assert_eq!(without_times(&infonerf), without_times(&repeated));
    let run = "fast-losses/knot/infonerf/seed0";
    assert_eq!(events(&place.path("runs").join(run)), events(&place.path("saved").join(run)));
    // A config that was saved by a run of itself is the same text.
    let config = |out: &str| place.read(&format!("{out}/{run}/config.toml"));
    assert_eq!(config("runs"), config("saved"));

    place.tiny(exp).args("--out other --seed 1").succeeds();
    let other = records(&place.path("other/fast-losses"));
    assert_ne!(other[0]["train_views"], json!([26, 86, 2, 55]));
}

const LONG: &str = "exp fast-losses --scene knot --variant infonerf --set train.iterations=1000 \
                    --set train.checkpoint_every=20 --set loss.kl.weight=1e-3 --set render.occupancy.warmup=10 \
                    --set render.occupancy.every=5";
const LONG_RUN: &str = "fast-losses/knot/infonerf/seed0";

/// Starts a run in the folder `out`, waits until there are two checkpoints in `field` of it, and interrupts it.
#[cfg(unix)]
fn interrupted(place: &Workplace, args: &str, out: &str, field: &str) -> std::process::Output {
    let mut command = place.tiny(args).args(format!("--out {out}")).into_command();
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for(&place.path(out).join(LONG_RUN).join(field).join("checkpoint.previous/manifest.json"));
    let status = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(status.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert!(!place.path(out).join("fast-losses/results.json").exists(), "the run had ended before it was stopped");
    output
}

/// Interrupts a command whose runs have processes of their own, but not these processes.
#[cfg(unix)]
#[test]
fn runs_side_by_side_stop_with_their_command() {
    let args = format!("{LONG} --set train.iterations=3000 --seed 0..1 --jobs 2");
    let output = interrupted(&Workplace::new(), &args, "jobs", "");
    assert_has(&text(&output.stdout), &["seed1: saved; the same command continues it"]);
}

/// If the newest checkpoint is damaged, the run continues from the one before it.
#[cfg(unix)]
#[test]
fn a_run_that_was_stopped_and_damaged_goes_on_to_the_same_numbers() {
    let place = Workplace::new();
    place.tiny(LONG).args("--out unbroken").succeeds();
    let output = interrupted(&place, LONG, "stopped", "");
    assert_has(&text(&output.stdout), &["the same command continues it"]);
    let run = |out: &str| place.path(out).join(LONG_RUN);
    let model = run("stopped").join("checkpoint/model.bpk");
    let bytes = fs::read(&model).unwrap();
    fs::write(&model, &bytes[..bytes.len() / 2]).unwrap();
    assert_has(&text(&place.tiny(LONG).args("--out stopped").succeeds().stderr), &["model.bpk", "damaged"]);
    let numbers = |out: &str| (without_times(&records(&place.path(out).join("fast-losses"))), events(&run(out)));
    assert_eq!(numbers("unbroken"), numbers("stopped"));

    // A finished run is kept as it is, and its results are printed.
    let again = || place.tiny(LONG).args("--out stopped");
    let left = || (fs::read(place.path("stopped/fast-losses/results.json")).unwrap(), files(&run("stopped")));
    let before = left();
    let stdout = again().env("COLUMNS", "40").succeeds_with(&[" dB", "finished before"]);
    assert!(rule(&stdout) <= 40, "{stdout}");
    // A run with another config is refused, and a run that is impossible does not remove an earlier one.
    let other = || again().args("--set train.lr=1e-3");
    other().fails_with(&["config.toml", "train.lr was ", "and is 0.001", "--overwrite", "--out"]);
    other().args("--overwrite --set render.space=ndc").fails_with(&["render.space"]);
    assert_eq!(before, left());
    other().args("--overwrite").succeeds();
    assert_ne!(before.0, left().0);
    assert_eq!(before.1, left().1);
}

/// An ensemble of three fields, more than some machines train side by side, is stopped in the middle.
#[cfg(unix)]
#[test]
fn an_ensemble_goes_on_to_the_same_numbers() {
    let place = Workplace::new();
    let ensemble: &str = &format!("{LONG} --set train.iterations=300 --set train.ensemble.size=3");
    place.tiny(ensemble).args("--out unbroken").succeeds();
    let unbroken = without_times(&records(&place.path("unbroken/fast-losses")));
    assert_eq!(unbroken[0]["iterations"], 900);
    interrupted(&place, ensemble, "stopped", "member0");
    place.tiny(ensemble).args("--out stopped").succeeds();
    assert_eq!(without_times(&records(&place.path("stopped/fast-losses"))), unbroken);
    for field in ["member0", "member1", "member2"] {
        let log = |out: &str| events(&place.path(out).join(LONG_RUN).join(field));
        assert_eq!(log("unbroken"), log("stopped"), "{field}");
    }
}

#[test]
fn a_run_is_evaluated_again() {
    let place = Workplace::new();
    place.tiny("exp fast-losses --scene crane --variant infonerf").succeeds();
    let run = "runs/fast-losses/crane/infonerf/seed0";
    let record = &records(&place.path("runs/fast-losses"))[0];

    let stdout = place.run(format!("eval {run}")).stdout();
    let mean = stdout.lines().find(|line| line.starts_with("mean")).unwrap();
    let [psnr, ssim, iou] = ["psnr", "ssim", "silhouette_iou"].map(|key| record[key].as_f64().unwrap());
    assert_has(mean, &[&format!("{psnr:.2} dB"), &format!("SSIM {ssim:.3}"), &format!("Silhouette IoU {iou:.3}")]);
    place.run(format!("eval {run} --test first-1")).succeeds_with(&["1 test view (first-1)"]);
    // Each run has a row, named by its folder: PSNR at full size, which is the record's, and at smaller sizes with the difference from it.
    let stdout = place.run(format!("eval {run} {run} --scale 1/2,1/4")).stdout();
    let rows: Vec<&str> = stdout.lines().filter(|line| line.starts_with(&format!("{run}  "))).collect();
    assert!(rows.len() == 2 && rows[0] == rows[1], "{stdout}");
    let numbers: Vec<f64> = rows[0].split([' ', '(', ')']).filter_map(|number| number.parse().ok()).collect();
    let [full, half, half_gain, quarter, quarter_gain] = numbers[..] else { panic!("{stdout}") };
    assert!((full - psnr).abs() < 0.006, "{stdout}");
    assert!((full + half_gain - half).abs() < 0.011 && (full + quarter_gain - quarter).abs() < 0.011, "{stdout}");
    assert!(half != full, "{stdout}");
}

/// A capture that holds out views of one list has other training views if training views are tested.
#[test]
fn a_run_is_not_tested_by_views_that_it_learned_from() {
    let place = Workplace::new();
    place.run("scene export facade data/facade --format llff --size 24").succeeds();
    place.tiny("exp fast-losses --data data --scene facade --variant factored --set eval.test=split").succeeds();
    let run = "runs/fast-losses/facade/factored/seed0";
    let fault = "--test: expected another protocol than training, found training";
    let reason = "LLFF photographs are held out only where they are tested";
    place.run(format!("eval {run} --test training")).fails_with(&[fault, reason]);
    place.run(format!("eval {run} --test first-1")).succeeds();
}

#[test]
fn an_exported_scene_gives_the_numbers_of_the_built_in_one() {
    let place = Workplace::new();
    let listed = place.run("scene list").stdout();
    assert!(listed.lines().count() >= 4 && listed.lines().any(|line| line == "orrery"), "{listed}");
    place.run("list").succeeds_with(&["fast-losses"]);
    place.run("scene export orrery data/orrery --size 24").succeeds();
    let exp = "exp fast-losses --variant infonerf";
    place.tiny(exp).args("--scene orrery").succeeds();
    place.tiny(exp).args("--data data --out loaded").succeeds_with(&["scenes from data"]);
    let [built_in, loaded] =
        ["runs", "loaded"].map(|out| without_times(&records(&place.path(out).join("fast-losses"))).remove(0));
    for key in keys().into_iter().filter(|key| *key != "notes") {
        assert_eq!(built_in.get(key), loaded.get(key), "{key}");
    }
    // The config of a run on a folder works from anywhere.
    let saved = place.path("loaded/fast-losses/orrery/infonerf/seed0/config.toml");
    fs::create_dir(place.path("elsewhere")).unwrap();
    let mut command = place.run("exp").arg(saved.to_str().unwrap()).into_command();
    assert!(command.current_dir(place.path("elsewhere")).output().unwrap().status.success());
    let again = without_times(&records(&place.path("elsewhere/runs/fast-losses")));
    assert_eq!(loaded, again[0]);
}

#[test]
fn an_experiment_file_changes_another() {
    let place = Workplace::new();
    let file = "base = \"fast-losses\"\ntitle = \"mine\"\nscenes = [\"castle\"]\nseeds = [3]\n\n[config.train]\nlr = 2e-3\n\n[variants.half.loss]\nentropy.weight = 5e-4\n";
    place.write("mine.toml", file);
    let exp = "exp mine.toml --variant half --device ndarray --budget 300ms";
    place.tiny(exp).args("--set train.iterations=1000000").succeeds();
    let record = &records(&place.path("runs/mine"))[0];
    assert_eq!(json!([record["variant"], record["seed"], record["device"]]), json!(["half", 3, "ndarray"]));
    let config: toml::Table = place.read("runs/mine/castle/half/seed3/config.toml").parse().unwrap();
    assert_eq!(config["config"]["train"]["lr"].as_float(), Some(2e-3));
    assert_eq!(config["config"]["loss"]["entropy"]["weight"].as_float(), Some(5e-4));
    assert_eq!(config["budget_seconds"].as_float(), Some(0.3));
    // The clock decides, not the number of steps.
    assert!(record["train_seconds"].as_f64().unwrap() >= 0.3);
    assert!((1..1_000_000).contains(&record["iterations"].as_u64().unwrap()));
}

const TINY_PIXELNERF: &str = "--set field={kind='pixelnerf',encoder={width=4,blocks=[1],weights=''},blocks=2,\
                              pool_after=1,width=8,frequencies=2,lowest_frequency=1.5,density='softplus'} \
                              --set train={batch='held-out',iterations=4,rays=32,unseen_rays=16} \
                              --set scene={size=16,views={kind='seed',count=2}}";

#[test]
fn weights_learned_on_many_scenes_begin_another_run() {
    let place = Workplace::new();
    let small = "--set eval.test=first-1 --set eval.information_rays=16";
    let pretrain = || place.run("pretrain pixelnerf-pretrain --scene random-0..2 --out out").args(TINY_PIXELNERF);
    let exp = || {
        let args = "exp integration-pixelnerf --scene random-7 --seed 0 --out out";
        place.run(args).args(TINY_PIXELNERF).args(small).args("--set train.init=out/pixelnerf-pretrain")
    };
    exp().fails_with(&["train.init", "out/pixelnerf-pretrain", "infonerf pretrain"]);
    pretrain().succeeds_with(&["3 scenes", "train.init=out/pixelnerf-pretrain"]);
    let scenes = "scenes = [\"random-0\", \"random-1\", \"random-2\"]";
    assert_has(&place.read("out/pixelnerf-pretrain/config.toml"), &[scenes]);
    // The same command has nothing left to do. Another learning rate is refused, since it is another run.
    pretrain().succeeds_with(&["4 steps in ", "train.init=out/pixelnerf-pretrain"]);
    let other = || pretrain().args("--set train.lr=1e-3");
    other().fails_with(&["out/pixelnerf-pretrain/config.toml", "train.lr was ", "--overwrite"]);
    exp().succeeds();
    let records = records(&place.path("out/integration-pixelnerf"));
    assert_eq!(records.len(), 3);
    for record in &records {
        assert_has(&record["notes"].to_string(), &["initial weights from out/pixelnerf-pretrain"]);
    }
    // A run holds its own weights.
    fs::remove_dir_all(place.path("out/pixelnerf-pretrain")).unwrap();
    let run = "out/integration-pixelnerf/random-7/pixelnerf/seed0";
    place.run(format!("eval {run}")).succeeds();
    place.run(format!("render {run} --normals")).fails_with(&["--normals", "ResNet"]);
    pretrain().args("--seed 0..1").fails_with(&["one variant and one seed"]);
}

#[test]
fn help_can_be_learned_from() {
    let place = Workplace::new();
    let help = place.run("--help").stdout();
    assert!(!help.contains("sweep-item"), "{help}");
    for command in ["exp", "eval", "render", "export", "view", "scene", "list"] {
        assert!(help.lines().any(|line| line.trim_start().starts_with(command)), "{command}: {help}");
    }
    let parts = ["--data", "--scene", "--seed", "--set", "--budget", "--overwrite", "Examples:", "flex"];
    // Devices that are not built in are not offered, and internal commands are not listed.
    assert!(!place.run("exp --help").succeeds_with(&parts).contains("cuda"));
    let help = place.run("eval --help").stdout();
    let (own, pictures) = help.split_once("Pictures of other programs:").unwrap();
    assert_has(own, &["--device", "--test"]);
    assert_has(pictures, &["--renders"]);
}

#[test]
fn experiments_and_their_settings_are_described() {
    let place = Workplace::new();
    let parts = ["variants  ", "infonerf+", "scenes    ", "castle", "training  ", "[variants."];
    let described = place.run("list fast-losses").succeeds_with(&parts);
    assert_has(&described, &["data      built-in", "time      about 2 minutes on two cores"]);
    place.run("list nothing").fails_with(&["nothing", "expected an experiment file or one of"]);
    let printed = place.run("config fast-losses --variant infonerf --set train.rays=77").stdout();
    for (start, origin) in
        [("train.rays = 77 ", "# --set"), ("scene.background = ", "# preset fast"), ("loss.entropy.weight", "# ")]
    {
        assert!(printed.lines().any(|line| line.starts_with(start) && line.contains(origin)), "{start}: {printed}");
    }
    // The printed config is valid as a part of an experiment file.
    place.write("mine.toml", format!("base = \"fast-losses\"\nscenes = [\"knot\"]\n{printed}"));
    let again = place.run("config mine.toml --variant infonerf").stdout();
    assert!(again.lines().any(|line| line.starts_with("train.rays = 77 ") && line.contains("# mine.toml")), "{again}");
}

#[test]
fn shells_complete_names_and_keys() {
    let place = Workplace::new();
    place.run("").env("COMPLETE", "bash").succeeds_with(&["complete -o nospace", "_clap_complete_infonerf"]);
    fs::create_dir_all(place.path("data/lego")).unwrap();
    place.write("mine.toml", "base = \"fast-losses\"\n[variants.own]\ntrain.rays = 99\n");
    let candidates = |line: &str| -> BTreeSet<String> {
        // With a space at the end, the next word is completed.
        let stdout = line.split(' ').fold(place.run("-- infonerf"), Invocation::arg).env("COMPLETE", "fish").stdout();
        stdout.lines().map(|line| line.split('\t').next().unwrap().to_owned()).collect()
    };
    for (line, expected) in [
        ("exp synth", "synthetic-4view"),
        ("exp m", "mine.toml"),
        ("sweep fast", "fast-losses"),
        ("bench skip --experiment fast", "fast-losses"),
        ("exp fast-losses --variant fac", "factored"),
        ("config integration --variant mip", "mipnerf"),
        ("exp mine.toml --variant o", "own"),
        ("exp fast-losses --scene cra", "crane"),
        ("exp fast-losses --data data --scene ", "lego"),
        ("exp fast-losses --set loss.entropy.w", "loss.entropy.weight="),
        ("exp synthetic-4view --set train.lr", "train.lr="),
        ("capture photos --set scene.vi", "scene.views="),
        ("sweep baselines --grid field.k", "field.kind="),
    ] {
        let found = candidates(line);
        assert!(found.contains(expected), "{line}: {found:?}");
        let last = line.rsplit(' ').next().unwrap();
        assert!(found.iter().all(|candidate| candidate.starts_with(last)), "{line}: {found:?}");
    }
    assert!(!candidates("exp fast-losses --set train.lr.").contains("train.lr.from="), "a schedule has one key");
    assert!(!candidates("exp fast-losses --variant ").contains("own"), "of another experiment");
}

#[test]
fn results_are_collected_into_one_document() {
    let place = Workplace::new();
    place.tiny(EXP).args("--out results-of-mine").succeeds();
    place.run("collect results-of-mine/fast-losses --title All").succeeds();
    let document = place.read("results.md");
    assert_has(&document, &["# All", "infonerf exp", "--scene knot", "PSNR", "train views 26, 86, 2, 55"]);
    assert!(!document.contains("results-of-mine"), "{document}");
    // A sweep, and an experiment of one's own.
    place.write("mine.toml", "base = \"fast-losses\"\ntitle = \"mine\"\n");
    place.tiny("sweep mine.toml --scene knot --variant factored --grid train.lr=1e-3,2e-3").succeeds();
    place.tiny("exp mine.toml --scene knot --variant factored").succeeds();
    place.run("collect runs/sweep-mine runs/mine results-of-mine/fast-losses").succeeds();
    assert_has(&place.read("results.md"), &["## sweep-mine", "## mine", "mine.toml", "2e-3"]);
    // A run that was begun anew with another preset counts once.
    place.tiny(EXP).args("--out results-of-mine --preset dense --overwrite").succeeds();
    place.run("collect results-of-mine/fast-losses").succeeds();
    assert_has(&place.read("results.md"), &["\npreset dense ·"]);
    // Runs of one variant with different settings have a row each.
    for args in ["--seed 0", "--seed 1 --set train.rays=16"] {
        place.tiny("exp fast-losses --scene knot --variant factored --out mixed").args(args).succeeds();
    }
    place.run("collect mixed/fast-losses").succeeds();
    assert_has(&place.read("results.md"), &["| variant | rays |", "| factored | – |", "| factored | 16 |"]);
    // A document of the user is kept.
    place.write("notes.md", "My own notes.");
    place.write("photo.jpg", [0xff, 0xd8, 0xff]);
    for file in ["notes.md", "photo.jpg"] {
        place.run(format!("collect results-of-mine/fast-losses --out {file}")).fails_with(&[file, "--out"]);
    }
    place.run("collect results-of-mine/fast-losses --out /dev/full").fails_with(&["/dev/full: expected no file"]);
    place.run("collect nowhere").fails_with(&["nowhere", "results.json: not found"]);
    place.run("collect mixed").fails_with(&["results.json, such as mixed/fast-losses"]);
    // Results can be collected where the scenes are not.
    place.run("scene export knot data/knot --size 24").succeeds();
    place.tiny("exp fast-losses --data data --variant factored --out far").succeeds();
    fs::remove_dir_all(place.path("data")).unwrap();
    place.run("collect far/fast-losses").succeeds();
    let eval = place.run("eval far/fast-losses/knot/factored/seed0");
    eval.fails_with(&["seed0/config.toml: scene ", "data/knot: not found"]);
}

#[test]
fn other_programs_are_told_in_json_and_quiet_is_quiet() {
    let place = Workplace::new();
    let stdout = place.tiny(EXP).args("--json").stdout();
    let events: Vec<Value> = stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let names: Vec<&str> = events.iter().map(|event| event["event"].as_str().unwrap()).collect();
    assert_eq!((names[0], names[names.len() - 1]), ("loading", "finished"), "{names:?}");
    for name in ["started", "step", "trained", "evaluating", "record"] {
        assert!(names.contains(&name), "{name}: {names:?}");
    }
    let record = events.iter().find(|event| event["event"] == "record").unwrap();
    assert!(record["record"]["psnr"].is_f64());
    assert!(place.tiny(EXP).args("--quiet --overwrite").succeeds().stdout.is_empty());
    place.tiny(EXP).args("--quiet --json").fails_with(&["--json"]);
    // A run that fails does not end the others.
    place.write("two/fast-losses/knot/factored/seed0/test", "a file where the folder of renders would be");
    let both = place.tiny(EXP).args("--variant infonerf --out two --json").into_command().output().unwrap();
    assert_eq!(both.status.code(), Some(1));
    assert_has(&text(&both.stdout), &["\"failed\"", "seed0/test", "\"record\"", "\"finished\""]);
    assert_has(&text(&both.stderr), &["knot/factored", "failed"]);
    assert_eq!(records(&place.path("two/fast-losses")).len(), 1);
}

/// A closed pipe, such as that of `head`, costs no run and is not an error.
#[test]
fn output_that_nobody_reads_loses_nothing() {
    let place = Workplace::new();
    let unread = |invocation: Invocation| {
        let [(_, stdout), (_, stderr)] = [io::pipe().unwrap(), io::pipe().unwrap()];
        invocation.into_command().stdout(stdout).stderr(stderr).status().unwrap().code()
    };
    let exp = |out: &str| place.tiny(EXP).args(format!("--out {out}"));
    assert_eq!(unread(exp("lines")), Some(0));
    assert_eq!(unread(exp("events").args("--json")), Some(0));
    for out in ["lines", "events"] {
        assert_eq!(records(&place.path(out).join("fast-losses")).len(), 1);
    }
    let run = "lines/fast-losses/knot/factored/seed0";
    let (eval, export) = (format!("eval {run}"), format!("export {run} --format cameras"));
    for args in ["list", "--help", "list fast-losses", &eval, &export] {
        assert_eq!(unread(place.run(args)), Some(0), "{args}");
    }
    assert_eq!(unread(place.run("exp nothing")), Some(2));
    // A full disk is an error, which comes after the run is saved.
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = exp("full").into_command().stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert_has(&text(&output.stderr), &["standard output: No space left"]);
    assert_eq!(records(&place.path("full/fast-losses")).len(), 1);
}

#[test]
fn pages_say_where_to_look_and_that_they_wait() {
    let place = Workplace::new();
    let output = place.tiny(EXP).args("--view=0").succeeds();
    let stdout = text(&output.stdout);
    assert_has(&stdout, &["live at http://127.0.0.1:"]);
    assert!(stdout.ends_with("to look at the runs again: infonerf view runs/fast-losses\n"), "{stdout}");
    assert!(!text(&output.stderr).contains("HTTP"), "{}", text(&output.stderr));
    fs::create_dir(place.path("empty")).unwrap();
    let said = fs::File::create(place.path("said")).unwrap();
    let mut view = place.run("view empty --port 0").into_command().stdout(said).spawn().unwrap();
    wait_until("a line on runs", || place.read("said").contains("no run is there yet: the page waits for one"));
    view.kill().unwrap();
    view.wait().unwrap();
}
