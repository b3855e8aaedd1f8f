//! Bad input gives one clear line that names the file and the field, and exit code 2; never a panic.

use std::fs;
use std::path::Path;

use crate::common::{EXP, RUN, Workplace};
use serde_json::{Value, json};

fn with_scene() -> Workplace {
    let place = Workplace::new();
    place.run("scene export knot data/knot --size 24").succeeds();
    place
}

const ON_DATA: &str = "exp fast-losses --data data --scene knot --variant factored";

/// Changes a file, asserts that a run fails with `parts`, and restores the file.
fn changed(place: &Workplace, file: &str, change: impl FnOnce(&Path), parts: &[&str]) {
    let path = place.path("data/knot").join(file);
    let whole = fs::read(&path).unwrap();
    change(&path);
    place.tiny(ON_DATA).fails_with(&[&[file], parts].concat());
    fs::write(&path, whole).unwrap();
}

#[test]
fn files_of_a_scene() {
    let place = with_scene();
    let halve = |path: &Path| {
        let bytes = fs::read(path).unwrap();
        fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    };
    changed(&place, "train/r_26.png", halve, &["PNG"]);
    changed(&place, "test/r_1.png", |path| fs::remove_file(path).unwrap(), &["not found"]);
    changed(&place, "test/r_0_depth.npy", halve, &[]);
    let train = "transforms_train.json";
    changed(&place, train, |path| fs::write(path, "").unwrap(), &[]);
    for file in [train, "transforms_test.json"] {
        let edit = |path: &Path| {
            let mut json: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
            json["frames"][7]["transform_matrix"] = json!([[1, 0, 0, 0]]);
            fs::write(path, json.to_string()).unwrap();
        };
        changed(&place, file, edit, &["frames[7].transform_matrix", "1 rows"]);
    }
}

#[test]
fn folders() {
    let place = with_scene();
    let dietnerf = "--set loss.semantic.weight=0.1 --set loss.semantic.weights=clip-vit-base-patch32.safetensors";
    let absent = "clip-vit-base-patch32.safetensors: No such";
    place.tiny(EXP).args(dietnerf).fails_with(&["loss.semantic.weights", "openai/clip-vit-base-patch32", absent]);
    let data = |data: &str, scene: &str| place.tiny(format!("exp fast-losses --data {data} --scene {scene}"));
    data("nowhere", "knot").fails_with(&["nowhere"]);
    data("data", "lego").fails_with(&["data/lego", "not found"]);
    data("data", "../data/knot").fails_with(&["../data/knot"]);
    place.tiny("exp fast-losses --data nowhere").fails_with(&["nowhere"]);
    // The scene that can be read comes first, and is not trained on.
    place.run("scene export knot data/last --size 24").succeeds();
    place.write("data/last/train/r_26.png", "");
    place.tiny("exp fast-losses --data data --out early --variant factored").fails_with(&["data/last", "r_26.png"]);
    assert!(!place.path("early/fast-losses/knot").exists());
    fs::create_dir_all(place.path("data/empty")).unwrap();
    data("data", "empty").fails_with(&["data/empty", "transforms_train.json"]);
    fs::create_dir_all(place.path("hollow")).unwrap();
    place.tiny("exp fast-losses --data hollow").fails_with(&["hollow"]);
    place.write("file", "");
    place.tiny("exp fast-losses --data file").fails_with(&["file"]);
}

/// Checks a fault of each part and stage; the crates' own tests check each key.
#[test]
fn config() {
    let place = Workplace::new();
    for (setting, parts) in [
        ("scene.views.count=101", &["scene.views", "found 101"][..]),
        ("scene.size=1000000", &["scene.size", "1000000"]),
        ("scene.background=[0.5,2.0,0.5]", &["background"]),
        ("train.iterations=0", &["train.iterations"]),
        ("train.lr=nan", &["train.lr"]),
        (
            "train.lr={from=1e-3,factor=0.1}",
            &["train.lr: expected a number, ", "every", "found { factor = 0.1, from = 0.001 }"],
        ),
        ("train.lr={from=1,to=\"x\"}", &["train.lr: expected a number, ", "found { from = 1, to = \"x\" }"]),
        (
            "train.lr={from=1,to=2,curve=\"cubic\"}",
            &["curve = \"linear\" or \"exponential\"", "found { curve = \"cubic\""],
        ),
        ("train.lr={from=1e-3,to=0.0,curve=\"exponential\"}", &["train.lr", "above 0"]),
        ("loss.entropy.mask.threshold=high", &["loss.entropy.mask"]),
        ("loss.kl.epsilon=0.0", &["loss.kl.epsilon"]),
        ("render.hidden_depth=-1.0", &["render.hidden_depth"]),
        ("field.kind=mip", &["field: missing key `layers`; a field of another kind keeps no key of the former"]),
        ("field.channels=3", &["field.channels"]),
        ("field.resolutions=[4,1]", &["field.resolutions"]),
        ("train.adam_beta2=1.0", &["train.adam_beta2"]),
        ("loss.entropy.weight={from=0.0,to=1.0,end=1.5}", &["loss.entropy.weight", "end"]),
        ("eval.test=first-100000", &["eval.test", "from 1 to 200", "100000"]),
    ] {
        place.tiny(format!("exp fast-losses --scene knot --set {setting}")).fails_with(parts);
    }
}

#[test]
fn arguments() {
    let place = Workplace::new();
    let exp = |args: &str| place.tiny("exp fast-losses --scene knot").args(args);
    exp("--device vulkan").fails_with(&["--device vulkan", "not built in", "flex"]);
    exp("--device cuda").fails_with(&["--device cuda", "not built in"]);
    exp("--variant best").fails_with(&["--variant best", "infonerf"]);
    exp("--scene lego").fails_with(&["--scene lego", "knot"]);
    exp("--scene knot").fails_with(&["--scene knot", "twice"]);
    place.run("demo --scene lego").fails_with(&["--scene", "lego", "expected one of castle, crane"]);
    exp("--seed 1 --seed 1").fails_with(&["--seed 1", "twice"]);
    place.tiny("exp capture").fails_with(&["infonerf capture my-photos", "--data . --scene my-photos", "--scene room"]);
    exp("--seed 4294967296").fails_with(&["NumPy seed"]);
    place.run("exp synthetic-5view").fails_with(&["synthetic-5view", "fast-losses"]);
    place.run("exp mine.toml").fails_with(&["mine.toml: expected an experiment file: No such file"]);
    place.run("exp .").fails_with(&[".: expected an experiment file or one of"]);
    place.run("exp released-small").fails_with(&["released-small: variants: expected at least one"]);
    place.run("scene export lego data").fails_with(&["lego", "knot"]);
    place.run("scene export room data --format film").fails_with(&["--format", "film", "llff"]);

    exp("--budget soon").fails_with(&["--budget", "soon"]);
    exp("--budget -5s").fails_with(&[]);
    exp("--budget 0s").fails_with(&["--budget", "0s"]);
    exp("--seed one").fails_with(&["--seed", "one"]);
    exp("--colour").fails_with(&["--colour"]);
    place.run("render run --path ORBIT").fails_with(&["--path ORBIT: not found; expected orbit, spiral"]);
    place.run("figure nowhere").fails_with(&["nowhere", "a finished run", "results.json"]);
    place.run("exp fast-losses").arg("--out=").fails_with(&["--out", "for the current one"]);
    place.run("view run --host every..where").fails_with(&[
        "--host",
        "every..where",
        "such as 0.0.0.0, ::1 or localhost",
    ]);
    // The name is an address, so the run is what is missing.
    place.run("view run --host localhost").fails_with(&["error: run: "]);
}

#[test]
fn experiment_files() {
    let place = Workplace::new();
    let claim = |is: &str, right: &str| {
        let comparison = format!("{{ left = \"nerf\", is = \"{is}\", right = \"{right}\" }}");
        let base = "base = \"synthetic-4view\"\n[[claims]]\nstatement = \"s\"\nmetric = \"psnr\"\n";
        format!("{base}comparisons = [{comparison}]\n")
    };
    place.write("base.toml", "scenes = [\"lego\"]\n[variants.a]\n");
    for (file, parts) in [
        ("[variants.a]\n[config.train]\niterationz = 3\n", &["iterationz"][..]),
        ("[variants.a\n", &["line 1"]),
        ("", &["mine.toml: variants: expected at least one", "[variants.NAME]"]),
        ("variants = 3\n", &["line 1", "expected a table, found 3"]),
        ("base = \"nothing\"\n", &["mine.toml: base: nothing: expected an experiment file or one of"]),
        ("base = \"mine.toml\"\n", &["base"]),
        ("seeds = [0]\ntitel = \"x\"\n[variants.a]\n", &["line 2: titel: "]),
        ("preset = \"best\"\n[variants.a]\n", &["line 1: preset: expected one of fast, ", "found \"best\""]),
        ("scenes = [\"lego\"]\n[variants.a]\n", &["mine.toml: scenes lego: expected one of the built-in scenes"]),
        (
            "data = \".\"\nscenes = [\"lego\"]\n[variants.a]\n",
            &["mine.toml: scenes lego: expected the scene's folder ./lego"],
        ),
        ("base = \"base.toml\"\n", &["base.toml: scenes lego: expected one of"]),
        ("scenes = []\n[variants.a]\n", &["mine.toml: scenes: expected at least one"]),
        ("scenes = \"knot\"\n[variants.a]\n", &["line 1: scenes: ", "expected a list"]),
        ("seeds = [-1]\n[variants.a]\n", &["line 1: seeds: ", "a whole number of at least 0"]),
        ("seeds = [3, 3]\n[variants.a]\n", &["mine.toml: seeds 3: given twice"]),
        ("budget_seconds = -1\n[variants.a]\n", &["mine.toml: budget_seconds: ", "seconds above 0, found -1"]),
        (
            claim("better", "infonref").as_str(),
            &["mine.toml: claims[0]: expected variants among nerf, ", "\"infonref\""],
        ),
        (claim("gooder", "infonerf").as_str(), &["found \"gooder\""]),
    ] {
        place.write("mine.toml", file);
        place.tiny("exp mine.toml").fails_with(parts);
    }
    place.write("mine.toml", [0xff, 0xfe, 0x00]);
    place.tiny("exp mine.toml").fails_with(&["mine.toml"]);
}

#[test]
fn output_that_cannot_be_written() {
    let place = Workplace::new();
    place.write("file", "");
    place.tiny(EXP).args("--out file").fails_with(&["--out", "expected a folder", "file is a file"]);
    place.tiny(EXP).args("--out /proc/nowhere").fails_with(&["/proc/nowhere"]);
    // A folder where a file has to go, and a file where a folder has to go.
    let run = "fast-losses/knot/factored/seed0";
    for (part, taken) in [
        ("metrics.jsonl", "metrics.jsonl/below"),
        ("config.toml", "config.toml/below"),
        ("lock", "lock/below"),
        ("test", "test"),
        ("checkpoint", "checkpoint"),
    ] {
        place.write(&format!("no-{part}/{run}/{taken}"), "");
        place.tiny(EXP).args(format!("--out no-{part}")).fails_with(&[part]);
    }
    place.write("runs/fast-losses/results.json", "no JSON");
    place.tiny(EXP).fails_with(&["results.json"]);
    place.run("scene export knot file/below --size 8").fails_with(&["file/below"]);
}

#[test]
fn folders_that_are_no_run() {
    let place = Workplace::new();
    for command in ["eval nowhere", "render nowhere", "export nowhere --format html"] {
        place.run(command).fails_with(&["nowhere: expected the folder of a run, with a config.toml: not found"]);
    }
    place.run("view nowhere").fails_with(&["nowhere: expected the folder of a run, or one that holds runs"]);
    place.tiny(EXP).succeeds();
    place.run("eval runs").fails_with(&["runs: expected the folder of a run, with a config.toml, such as ", RUN]);
    place.run(format!("eval {RUN} --test some")).fails_with(&["--test", "some"]);
    for scale in ["2", "1/1", "1/2;1/4", "1/x"] {
        place.run(format!("eval {RUN} --scale {scale}")).fails_with(&["--scale", "1/64"]);
    }
    place.write("file", "");
    place.run(format!("render {RUN} --frames 1 --out file")).fails_with(&["file"]);
    place.run(format!("export {RUN} --format html --out file/below")).fails_with(&["file/below"]);
    place.run("view file").fails_with(&["file", "folder"]);
    fs::create_dir(place.path("empty")).unwrap();
    place.run(format!("eval {RUN} --weights empty")).fails_with(&["--weights empty", "infonerf weights"]);

    let model = place.path(RUN).join("checkpoint/model.bpk");
    let whole = fs::read(&model).unwrap();
    fs::remove_dir_all(place.path(RUN).join("checkpoint.previous")).unwrap();
    fs::write(&model, &whole[..whole.len() - 1]).unwrap();
    place.run(format!("eval {RUN}")).fails_with(&["model.bpk", "damaged"]);
    fs::write(&model, &whole).unwrap();
    place.run(format!("eval {RUN}")).succeeds();

    let config = place.path(RUN).join("config.toml");
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&config, text.replace("width = 16", "width = 32")).unwrap();
    place.run(format!("eval {RUN}")).fails_with(&["checkpoint"]);
    fs::write(&config, text.replace("[config.scene]", "[config.scene]\nlight = 3")).unwrap();
    place.run(format!("eval {RUN}")).fails_with(&["config.toml", "light"]);
    fs::write(&config, &text).unwrap();
    fs::remove_dir_all(place.path(RUN).join("checkpoint")).unwrap();
    place.run(format!("eval {RUN}")).fails_with(&["checkpoint"]);
}
