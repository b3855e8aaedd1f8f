//! `infonerf eval --renders`, `infonerf weights` and `infonerf scene`, as a user runs them.

use std::fs;
use std::path::Path;

use crate::common::{EXP, RUN, Workplace, records};
use infonerf_pretrained::{LpipsConfig, TensorShape};
use serde_json::{Map, Value, json};

#[test]
fn pictures_of_a_run_measure_as_its_record_says() {
    let place = Workplace::new();
    place.tiny(EXP).succeeds();
    let eval = format!("eval --renders {RUN}/test --truth {RUN}/truth --out compared");
    place.run(eval).succeeds_with(&["8-bit RGB on white"]);
    let compared: Value = serde_json::from_str(&place.read("compared/comparison.json")).unwrap();
    let record = &records(&place.path("runs/fast-losses"))[0];
    for key in ["psnr", "ssim", "sharpness"] {
        let (there, here) = (record[key].as_f64().unwrap(), compared["mean"][key].as_f64().unwrap());
        assert!((there - here).abs() < 1e-9 * there.abs().max(1.0), "{key}: {there} and {here}");
    }
    let page = place.read("compared/comparison.html");
    assert_eq!(page.matches("type=\"range\"").count(), 2);
}

#[test]
fn pictures_that_do_not_fit_are_one_line() {
    let place = Workplace::new();
    for (folder, side) in [("a", 16), ("b", 16), ("small", 8)] {
        fs::create_dir(place.path(folder)).unwrap();
        let picture = image::RgbImage::from_pixel(side, side, image::Rgb([9, 8, 7]));
        picture.save(place.path(folder).join("0.png")).unwrap();
    }
    for (arguments, part) in [
        ("--renders a --truth small", "a/0.png"),
        ("--renders absent --truth a", "absent"),
        ("--renders a --truth b --metric fid", "fid"),
        ("--renders a --truth b --metric vmaf", "--metric: no metric is called `vmaf`"),
        ("--renders a --truth nowhere", "--truth nowhere: expected a folder of pictures"),
        ("--renders a --truth b --protocol ours", "expected one of infonerf"),
        ("a --truth b", "--truth"),
        ("a --out b", "--out"),
    ] {
        place.run("eval").args(arguments).fails_with(&[part]);
    }
}

#[test]
fn weights_are_listed_and_bad_files_refused() {
    let place = Workplace::new();
    let parts = ["lpips-alex", "lpips-vgg-heads", "clip-vit-b32", "resnet34", "not here", "SHA-256"];
    place.run("weights").succeeds_with(&parts);
    place.write("text.pth", "no weights");
    place.run("weights import text.pth").fails_with(&["text.pth"]);
    // A backbone measures nothing without its linear heads.
    zero_weights(&place.path("backbone.safetensors"), &LpipsConfig::alex().backbone_tensors());
    zero_weights(&place.path("heads.safetensors"), &LpipsConfig::alex().head_tensors());
    let import = |file: &str| place.run(format!("weights import {file}")).env("INFONERF_WEIGHTS", "kept").stdout();
    let hint = "lpips-alex-heads is missing; `infonerf weights fetch lpips-alex-heads`";
    assert!(import("backbone.safetensors").contains(hint));
    import("heads.safetensors");
    assert!(!import("backbone.safetensors").contains("missing"));
    place.run("weights import absent.pth").fails_with(&["absent.pth"]);
    place.run("weights fetch lpips-squeeze").fails_with(&["lpips-squeeze"]);
}

fn zero_weights(path: &Path, tensors: &[TensorShape]) {
    let (mut header, mut end) = (Map::new(), 0);
    for (name, shape) in tensors {
        let start = end;
        end += 4 * shape.iter().product::<usize>();
        header.insert(name.clone(), json!({ "dtype": "F32", "shape": shape, "data_offsets": [start, end] }));
    }
    let header = Value::Object(header).to_string();
    let bytes = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), vec![0; end].as_slice()].concat();
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_scene_is_described_and_checked() {
    let place = Workplace::new();
    place.run("scene export castle castle --size 16").succeeds();
    place.run("scene info castle --page castle.html").succeeds_with(&["Blender", "100 to train on"]);
    assert!(place.read("castle.html").contains("<canvas"));
    assert!(serde_json::from_str::<Value>(&place.run("scene info castle --json").stdout()).is_ok());
    place.run("scene check castle").succeeds();
    place.run("scene info absent").fails_with(&["absent"]);
}
