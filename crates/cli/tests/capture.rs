//! `infonerf capture`: from photographs to pictures in one command.

use std::fs;
use std::process::Command;

use infonerf_scene::Image;

use crate::common::{Workplace, assert_has, records};
use crate::photographs::room;

/// Returns the paths of report, orbit and page in `stdout`, and asserts that they exist.
fn paths(place: &Workplace, stdout: &str) -> Vec<String> {
    let path = |name: &str| {
        let line = stdout.lines().rev().find_map(|line| line.strip_prefix(name));
        let path = line.unwrap_or_else(|| panic!("expected `{name}` in: {stdout}"));
        assert!(place.path(path).is_file(), "{path}");
        path.to_owned()
    };
    ["report: ", "orbit: ", "page: "].map(path).into()
}

/// With 40 photographs five are held out. A missing orbit is rendered later, and nothing is trained twice.
#[test]
fn posed_photographs_are_learned_measured_and_shown() {
    let place = Workplace::new();
    place.run("scene export room photos --format llff --size 24").succeeds();
    let capture = |args: &str| place.tiny_without("eval.test", format!("capture photos --out results {args}"));
    let next = "next: `infonerf view results`, or the same command with --budget 5s";
    let parts =
        ["40 photographs, about ", "none to find", "measured on 5 held-out photographs", " frames of 24 × 24", next];
    let stdout = capture("--budget 1s").succeeds_with(&parts);
    let files = paths(&place, &stdout);
    let training = || fs::read(place.path("results/capture/photos/infonerf+/seed0/metrics.jsonl")).unwrap();
    let first = training();
    let again = capture("--budget 1s").succeeds_with(&["(finished before)"]);
    assert!(!again.contains("frames"), "{again}");
    fs::remove_file(place.path(&files[1])).unwrap();
    let again = capture("--budget 1s").succeeds_with(&["(finished before)", " frames of 24 × 24"]);
    assert_eq!((paths(&place, &again), training()), (files, first.clone()));
    let longer = capture("--budget 2s").succeeds_with(&[" frames of 24 × 24"]);
    assert!(!longer.contains("(finished before)"), "{longer}");
    let notes = &records(&place.path("results/capture"))[0]["notes"];
    assert_has(&notes.to_string(), &["budget_seconds was 1.0 and is 2.0"]);
    assert!(training().starts_with(&first), "it goes on");
}

/// Eight fields end after two steps each, long before the budget, and a longer one is not advised.
#[test]
fn steps_of_a_field_are_limited() {
    let place = Workplace::new();
    place.run("scene export room photos --format llff --size 24").succeeds();
    let limit = "--set train.ensemble.max_steps=2 --set train.ensemble.max_steps_per_view=0";
    let command = format!("capture photos --out results --budget 20s --set train.ensemble.size=8 {limit}");
    let stdout = place.tiny_without("eval.test", command).stdout();
    assert!(stdout.contains("next: `infonerf view results`\n"), "{stdout}");
    assert_eq!(records(&place.path("results/capture"))[0]["iterations"], 16);
}

/// Poses are found once, and again with another photograph. Few photographs are all trained on, without metrics on them.
#[test]
fn few_photographs_without_poses_are_learned_from() {
    let place = Workplace::new();
    room(&place.path("photos"), &[0, 1, 3, 9]);
    place.write("photos/masks/lost.png", "");
    let command = "capture photos --budget 1s";
    let capture = || place.tiny_without("eval.test", command).env("PATH", place.path(""));
    let unmeasured = "no photograph is held out, so no figure is measured";
    let stdout = capture().succeeds_with(&["4 photographs, about ", "4 of 4 photographs placed", unmeasured]);
    assert!(!stdout.contains("PSNR") && stdout.matches("in masks without an image").count() == 1, "{stdout}");
    let record = &records(&place.path("runs/capture"))[0];
    assert_eq!(record["train_views"].as_array().unwrap().len(), 4);
    assert_eq!(record["train_files"], serde_json::json!(["00.png", "01.png", "03.png", "09.png"]));
    let again = capture().succeeds_with(&["(finished before)"]);
    assert!(!again.contains("placed"), "{again}");
    assert_eq!(paths(&place, &again), paths(&place, &stdout));
    room(&place.path("other/photos"), &[0, 1]);
    let other = place.run("capture other/photos --budget 1s");
    other.fails_with(&["infonerf+/seed0 is of ", "/photos; --out names another folder for results"]);
    room(&place.path("photos"), &[2]);
    let remedy = "removed since: 02.png; --overwrite finds the poses again and trains anew";
    place.tiny_without("eval.test", command).fails_with(&["runs/capture/photos/infonerf+/seed0", remedy]);
    let parts = ["finding poses again: ", "removed: 02.png", "finding the poses of 5 photographs", unmeasured];
    capture().arg("--overwrite").succeeds_with(&parts);
}

#[test]
fn what_is_no_folder_of_photographs_is_refused() {
    let place = Workplace::new();
    place.run("capture absent").fails_with(&["absent: expected a folder of photographs or a video file"]);
    place.write("walk.mp4", "");
    place.run("capture walk.mp4 --set scene.sise=9").env("PATH", place.path("")).fails_with(&["sise"]);
    let run = place.run("capture walk.mp4").env("PATH", place.path(""));
    run.fails_with(&["walk.mp4: expected the ffmpeg program", "ffmpeg is not on PATH"]);
    assert!(!place.path("runs").exists());
    fs::create_dir(place.path("photos")).unwrap();
    Image::filled(8, 8, [0.5; 3]).write_png(&place.path("photos/a.png")).unwrap();
    place.run("capture photos").fails_with(&["photos: expected at least two photographs: it has 1"]);
    // No poses can be found of two such photographs, and other faults are reported first.
    fs::create_dir(place.path("a:b")).unwrap();
    for file in ["photos/b.png", "a:b/a.png", "a:b/b.png"] {
        fs::copy(place.path("photos/a.png"), place.path(file)).unwrap();
    }
    place.run("capture a:b").fails_with(&["folder \"a:b\": expected a name that a folder can have", "':'; rename it"]);
    place.run("capture photos --set scene.sise=9").fails_with(&["sise"]);
}

/// The video has one sharp frame in every eight; the others are blurred.
#[test]
fn sharpest_frames_of_a_video_are_learned_from() {
    let place = Workplace::new();
    let ffmpeg = |args: &str| {
        Command::new("ffmpeg").current_dir(place.path("")).args(args.split(' ')).output().map(|output| output.status)
    };
    if ffmpeg("-version").is_err() {
        eprintln!("skipped: ffmpeg is not on PATH");
        return;
    }
    let views = room(&place.path("photos"), &[0, 1, 3, 9]);
    fs::create_dir(place.path("all")).unwrap();
    for frame in 0..32 {
        let sharp = &views[frame / 8].image;
        let image = if frame % 8 == 5 { Image::clone(sharp) } else { sharp.resized(45, 45).resized(360, 360) };
        image.write_png(&place.path(&format!("all/{frame:02}.png"))).unwrap();
    }
    let encoded = ffmpeg("-v error -framerate 30 -i all/%02d.png -c:v ffv1 -pix_fmt bgr0 walk.mkv").unwrap();
    assert!(encoded.success());
    let capture = || place.tiny_without("eval.test", "capture walk.mkv --budget 1s");
    let parts =
        ["walk.mkv: 32 frames", "counted from 0: 5, 13, 21, 29", "4 of 4 photographs placed", "runs/capture/walk/"];
    capture().succeeds_with(&parts);
    for (number, sharp) in (1..).zip(&views) {
        let path = place.path(&format!("runs/frames/walk/{number:03}.png"));
        assert_eq!(Image::read(&path, [1.0; 3]).unwrap().to_rgb8(), sharp.image.to_rgb8(), "{number}");
    }
    capture().succeeds_with(&["4 frames are in runs/frames/walk", "(finished before)"]);
    place.write("walk.mkv", "another");
    place.run("capture walk.mkv").fails_with(&["runs/frames/walk: expected frames of walk.mkv", "remove it"]);
}
