//! `infonerf export`, and `infonerf render` along camera paths, as a user runs them.

use std::fs;
use std::path::Path;

use crate::common::{EXP, Invocation, RUN, Workplace, files};
use infonerf_procedural::train_cameras;
use serde_json::{Value, json};

/// Setting of a field that is dense everywhere: its surface is that of the scene's box.
const DENSE: &str = "--set field.density_bias=5.0";

fn with_run() -> Workplace {
    let place = Workplace::new();
    place.tiny(EXP).args(DENSE).succeeds();
    place
}

fn export(place: &Workplace, format: &str, args: &str) -> Invocation {
    let resolution = if format == "cameras" { "" } else { "--resolution 16" };
    place.run(format!("export {RUN} --format {format} {resolution}")).args(args)
}

#[test]
fn a_mesh_of_a_built_in_scene_is_compared_with_the_exact_surface() {
    export(&with_run(), "ply", "").succeeds_with(&["chamfer distance to the exact surface"]);
}

/// The program does not know the exact surface of a scene on files.
#[test]
fn every_format_is_written_and_described() {
    let place = Workplace::new();
    place.run("scene export knot data/knot --size 24").succeeds();
    place.tiny(EXP).args(DENSE).args("--data data").succeeds();
    for (format, file, start, part) in [
        ("ply", "mesh.ply", &b"ply\nformat binary_little_endian"[..], "triangles"),
        ("glb", "mesh.glb", b"glTF\x02\0\0\0", "triangles"),
        ("splat", "splat.ply", b"ply\n", "gaussians"),
        ("points", "points.ply", b"ply\n", "points"),
        ("cameras", "transforms.json", b"{", "4 training and 2 test cameras"),
    ] {
        let stdout = export(&place, format, "").succeeds_with(&[file, part, "read by "]);
        let written = fs::read(place.path(RUN).join("export").join(file)).unwrap();
        assert!(written.starts_with(start), "{format}");
        assert!(!stdout.contains("chamfer distance"), "{stdout}");
        // Another export writes the same bytes.
        export(&place, format, "--out again").succeeds();
        assert_eq!(fs::read(place.path("again")).unwrap(), written, "{format}");
    }
    // Vertices, points and gaussians lie on one surface, which is that of the box.
    let count = |format: &str| -> usize {
        let stdout = export(&place, format, "--out out").stdout();
        stdout.split_once("out: ").unwrap().1.split_once(' ').unwrap().0.parse().unwrap()
    };
    let (vertices, gaussians, points) = (count("ply"), count("splat"), count("points"));
    assert_eq!((vertices, points), (gaussians, gaussians));
    // A vertex for each cell of the surface of 17 x 17 x 17 cells between the centres of voxels.
    assert_eq!(vertices, 17 * 17 * 17 - 15 * 15 * 15);
    let triangles = |format: &str, most: usize| -> usize {
        let stdout = export(&place, format, &format!("--triangles {most}")).stdout();
        stdout.split_once(" triangles").unwrap().0.rsplit(' ').next().unwrap().parse().unwrap()
    };
    assert!(triangles("ply", 1_000_000) > 2000);
    for (format, most) in [("ply", 500), ("glb", 100)] {
        let found = triangles(format, most);
        assert!((most / 2..=most).contains(&found), "{format}: {found} of {most}");
    }
}

/// NeRF's MLP, which a page cannot evaluate, is baked to voxels.
#[test]
fn a_page_of_the_papers_field_is_baked() {
    let place = Workplace::new();
    let mlp = "field={kind=\"nerf\",layers=2,width=16,skip=9,position_frequencies=4,direction_frequencies=2,\
               density=\"softplus\",detail=1.0}";
    let small = "--preset paper --set scene.size=24 --set train.iterations=2 --set train.rays=16 --set train.unseen_rays=16 \
                 --set render.samples=8 --set render.fine_samples=8 --set eval.test=first-1 --set eval.information_rays=16";
    place.run(EXP).args(small).args(format!("--set {mlp}")).succeeds();
    place.run(format!("render {RUN} --frames 1 --normals")).succeeds();
    assert_eq!(count(&place.path(RUN).join("render/normals"), ".png"), 1);
    assert!(!place.path(RUN).join("viewer.html").exists(), "only what takes no time is left by `exp`");
    let export = || place.run(format!("export {RUN} --format html --resolution 24"));
    export().succeeds_with(&["viewer.html", "read by browsers"]);
    let page = place.read(&format!("{RUN}/viewer.html"));
    assert!(page.contains("baked to 24 voxels along its box") && page.contains("uniform sampler3D opacities"));
    export().args("--out again").succeeds();
    assert_eq!(place.read("again"), page);
}

/// Cameras of a capture at half size that is tested on its training views, read back by nerfstudio's rules: each frame has the
/// path and size of an image file, no file twice, and the files of every split are frames.
#[test]
fn cameras_fit_next_to_the_image_files() {
    let place = Workplace::new();
    place.run("scene export facade data/facade --format llff --size 48").succeeds();
    let exp = "exp fast-losses --variant factored --data data --scene facade --set eval.test=training";
    place.tiny(exp).succeeds();
    let run = "runs/fast-losses/facade/factored/seed0";
    place.run(format!("export {run} --format cameras")).succeeds_with(&["its image paths start in", "data/facade"]);
    let cameras: Value = serde_json::from_str(&place.read(&format!("{run}/export/transforms.json"))).unwrap();
    let strings = |key: &str| -> Vec<String> {
        let list = cameras[key].as_array().unwrap_or_else(|| panic!("{key}: {cameras}"));
        list.iter().map(|name| name.as_str().unwrap().to_owned()).collect()
    };
    let mut files: Vec<&str> = Vec::new();
    for frame in cameras["frames"].as_array().unwrap() {
        let file = frame["file_path"].as_str().unwrap();
        let (width, height) = image::image_dimensions(place.path("data/facade").join(file)).unwrap();
        let number = |key: &str| frame[key].as_f64().unwrap();
        assert_eq!((number("w"), number("h")), (f64::from(width), f64::from(height)), "{file}");
        assert!((number("cx") / number("w") - 0.5).abs() < 0.05 && (number("cy") / number("h") - 0.5).abs() < 0.05);
        assert!(!files.contains(&file), "{file} twice");
        files.push(file);
    }
    for split in ["train", "val", "test"] {
        let names = strings(&format!("{split}_filenames"));
        assert!(!names.is_empty() && names.iter().all(|name| files.contains(&name.as_str())), "{split}: {names:?}");
    }
    assert_eq!(strings("train_filenames"), strings("test_filenames"));
    assert_eq!(cameras["camera_model"], "PINHOLE");
}

#[test]
fn impossible_exports_and_paths_are_refused() {
    let place = with_run();
    let export = |args: &str| export(&place, "ply", args);
    place.run(format!("export {RUN} --format points --triangles 9")).fails_with(&["--triangles", "expected a"]);
    place.run(format!("export {RUN} --format cameras --resolution 9")).fails_with(&["--resolution: expected another"]);
    place.write("file", "");
    export("--out file/below.ply").fails_with(&["file"]);
    for unknown in ["--variant nope", "--scene nope"] {
        place.run(format!("figure runs/fast-losses {unknown}")).fails_with(&[unknown, "expected one of those in runs"]);
    }
    place.run(format!("scene info {RUN} --json")).fails_with(&["--json", "found a run"]);
    export("--out a.glb").fails_with(&["--out a.glb: expected a file name that ends in .ply"]);
    export("--out runs").fails_with(&["runs", "expected a file"]);
    export("--out /proc/nowhere/mesh.ply").fails_with(&["/proc/nowhere"]);
    // A field that has hardly been trained has no half-opaque ray, and so no surface.
    place.tiny(EXP).args("--out begun").succeeds();
    let run = "begun/fast-losses/knot/factored/seed0";
    place
        .run(format!("export {run} --format ply --out new/folder/mesh.ply"))
        .fails_with(&["expected at least 0.5; train it longer, or take --format html, which needs no surface"]);
    assert!(!place.path("new").exists());
    fs::remove_dir_all(place.path(run).join("checkpoint")).unwrap();
    fs::remove_dir_all(place.path(run).join("checkpoint.previous")).unwrap();
    place.run(format!("export {run} --format ply")).fails_with(&["expected a checkpoint"]);

    let render = |path: &str| place.run(format!("render {RUN} --path {path}"));
    render("nowhere.json").fails_with(&["nowhere.json", "not found"]);
    let faults = [("{\"camera_path\": []}", "`camera_path`: expected a list of 1 to 10000 cameras"), ("{", "JSON")];
    for (text, part) in faults {
        place.write("path.json", text);
        render("path.json").fails_with(&["path.json", part]);
    }
}

fn entry(index: usize) -> Value {
    json!({"camera_to_world": train_cameras(8)[index].to_world.transpose().to_cols_array(), "fov": 40.0})
}

fn count(folder: &Path, extension: &str) -> usize {
    files(folder).iter().filter(|name| name.ends_with(extension)).count()
}

#[test]
fn cameras_follow_every_path() {
    let place = with_run();
    place.run(format!("render {RUN} --frames 5 --normals")).succeeds();
    assert_eq!(count(&place.path(RUN).join("render/normals"), ".png"), 5);
    let render = |path: &str, args: &str| place.run(format!("render {RUN} --path {path}")).args(args);
    for (index, path) in ["orbit", "spiral", "figure-eight", "interpolate"].into_iter().enumerate() {
        render(path, "--frames 3").succeeds_with(&["3 frames of 24 × 24", &format!("{path}.gif")]);
        let folder = place.path(RUN).join("render");
        // Frames of the previous path are removed, and its animation is kept.
        let left = [count(&folder, ".png"), count(&folder.join("normals"), ".png"), count(&folder, ".gif")];
        assert_eq!(left, [3, 0, index + 1]);
    }

    let nerfstudio = json!({"camera_path": [entry(0), entry(1)], "render_width": 30, "render_height": 20, "fps": 10});
    place.write("camera_path.json", nerfstudio.to_string());
    render("camera_path.json", "--out a").succeeds_with(&["2 frames of 30 × 20", "camera_path.gif"]);
    let keyframes = json!({"keyframes": [entry(0), entry(1)], "seconds": 0.5, "fps": 10, "is_cycle": true});
    place.write("mine.json", keyframes.to_string());
    for (args, frames) in [("--size 12 --out b", 5), ("--size 12 --out b --frames 4", 4)] {
        render("mine.json", args).succeeds();
        assert_eq!(count(&place.path("b"), ".png"), frames);
    }
    // Frames of one camera, of which the second is a copy, have the same pixels and depths.
    place.write("twice.json", json!({"camera_path": [entry(0), entry(1), entry(0)]}).to_string());
    render("twice.json", "--size 12 --out d").succeeds();
    let file = |name: &str| fs::read(place.path("d").join(name)).unwrap();
    for kind in ["", "depth/"] {
        let [first, second, third] = [0, 1, 2].map(|index| file(&format!("{kind}000{index}.png")));
        assert!(first == third && first != second, "{kind}");
    }
    place.write("photos/0001.png", "of the user");
    render("orbit", "--out photos").fails_with(&["--out photos: expected a folder without frames of another origin"]);
    assert!(place.path("photos/0001.png").exists());
    // The first frame is the first keyframe in both.
    let first = |folder: &str| image::open(place.path(folder).join("0000.png")).unwrap().to_rgb8();
    render("camera_path.json", "--size 12 --out c").succeeds();
    assert_eq!((first("b").dimensions(), first("c").dimensions()), ((12, 12), (12, 8)));
}
