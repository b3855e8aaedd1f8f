//! `infonerf capture`: from photographs to pictures in one command.

use std::fs;

use infonerf_scene::Image;

use crate::common::{Workplace, records};
use crate::photographs::room;

/// Returns the paths that `said` ends with, which have to exist.
fn paths(place: &Workplace, said: &str) -> Vec<String> {
    let path = |name: &str| {
        let line = said.lines().rev().find_map(|line| line.strip_prefix(name));
        let path = line.unwrap_or_else(|| panic!("expected `{name}` in: {said}"));
        assert!(place.path(path).is_file(), "{path}");
        path.to_owned()
    };
    ["report: ", "orbit: ", "page: "].map(path).into()
}

/// With 40 photographs five are held out; an unfinished orbit is made up for, and nothing is trained twice.
#[test]
fn posed_photographs_are_learned_measured_and_shown() {
    let place = Workplace::new();
    place.run("scene export room photos --format llff --size 24").succeeds();
    let capture = || {
        let run = place.tiny_without("eval.test", "capture photos --budget 1s --out results");
        run.said()
    };
    let said = capture();
    for part in ["40 photographs, about ", "none to find", "measured on 5 photographs", " frames of 24x24"] {
        assert!(said.contains(part), "expected `{part}` in: {said}");
    }
    assert!(said.contains("next: `infonerf view results`, or the same command with --budget 5s --overwrite"), "{said}");
    let files = paths(&place, &said);
    let training = || fs::read(place.path("results/capture/photos/infonerf+/seed0/metrics.jsonl")).unwrap();
    let first = training();
    let again = capture();
    assert!(again.contains("(finished before)") && !again.contains("frames"), "{again}");
    fs::remove_file(place.path(&files[1])).unwrap();
    let again = capture();
    assert!(again.contains("(finished before)") && again.contains(" frames of 24x24"), "{again}");
    assert_eq!((paths(&place, &again), training()), (files, first));
}

/// Poses are found once; of few photographs all are learned from, and no error on them is given for a result.
#[test]
fn few_photographs_without_poses_are_learned_from() {
    let place = Workplace::new();
    room(&place.path("photos"), &[0, 1, 3, 9]);
    let capture = || {
        let run = place.tiny_without("eval.test", "capture photos --budget 1s").env("PATH", place.path(""));
        run.said()
    };
    let said = capture();
    for part in ["4 photographs, about ", "09.png: placed", "no photograph is held out, so that no figure is measured"]
    {
        assert!(said.contains(part), "expected `{part}` in: {said}");
    }
    assert!(!said.contains("PSNR"), "{said}");
    assert_eq!(records(&place.path("runs/capture"))[0]["train_views"].as_array().unwrap().len(), 4);
    let again = capture();
    assert!(!again.contains("placed") && again.contains("(finished before)"), "{again}");
    assert_eq!(paths(&place, &again), paths(&place, &said));
}

#[test]
fn what_is_no_folder_of_photographs_is_refused() {
    let place = Workplace::new();
    place.run("capture absent").fails_with(&["absent: expected a folder of photographs"]);
    fs::write(place.path("walk.mp4"), "").unwrap();
    place.run("capture walk.mp4").fails_with(&["walk.mp4: expected a folder of photographs, found a file", "ffmpeg"]);
    fs::create_dir(place.path("photos")).unwrap();
    Image::filled(8, 8, [0.5; 3]).write_png(&place.path("photos/a.png")).unwrap();
    place.run("capture photos").fails_with(&["photos: expected at least two photographs: it has 1"]);
}
