//! Photographs without poses.

use std::fs;
use std::path::Path;

use crate::common::{Workplace, assert_has, text};
use infonerf_dataset::colmap::Reconstruction;
use infonerf_dataset::{SceneSource, load};
use infonerf_scene::{Image, SceneRequest, TestProtocol, View, ViewSelection};

/// Writes pictures of the built-in room to `dir`, and returns their views.
pub(crate) fn room(dir: &Path, ids: &[usize]) -> Vec<View> {
    let train = ViewSelection::Ids { ids: ids.to_vec() };
    let request = SceneRequest { train, test: TestProtocol::First(1), image_size: Some(360), ..Default::default() };
    let views = load(&SceneSource::Procedural("room".into()), &request).unwrap().train;
    fs::create_dir_all(dir).unwrap();
    for (view, id) in views.iter().zip(ids) {
        view.image.write_png(&dir.join(format!("{id:02}.png"))).unwrap();
    }
    views
}

/// Four of five photographs are placed; the fifth shows something else.
#[test]
fn poses_of_photographs_alone() {
    let place = Workplace::new();
    let dir = place.path("photos");
    room(&dir, &[0, 1, 3, 9]);
    Image::filled(360, 360, [0.2, 0.4, 0.6]).write_png(&dir.join("10.png")).unwrap();
    let command = "scene from-images photos --poses own";
    let unplaced = "10.png: not placed: 0 matches with placed photographs, 15 needed";
    place.run(command).succeeds_with(&["4 of 5 photographs placed", unplaced, "next: infonerf capture photos"]);
    assert_eq!(Reconstruction::read(&dir).unwrap().images.len(), 4);
    place.run("scene info photos").succeeds();
    place.run(command).fails_with(&["sparse", "remove this one to make another"]);
}

#[cfg(unix)]
fn write_colmap(place: &Workplace, script: &str) {
    use std::os::unix::fs::PermissionsExt;
    place.write("colmap", script);
    fs::set_permissions(place.path("colmap"), fs::Permissions::from_mode(0o755)).unwrap();
}

/// A COLMAP that fails is ignored. Photographs of different things are refused, and no files are left behind.
#[cfg(unix)]
#[test]
fn photographs_that_cannot_be_placed() {
    let place = Workplace::new();
    let dir = place.path("photos");
    room(&dir, &[0]);
    write_colmap(&place, "#!/bin/sh\necho oops\nexit 1\n");
    let run = || place.run("scene from-images photos").env("PATH", place.path(""));
    run().fails_with(&["at least two photographs: it has 1"]);
    Image::filled(360, 360, [0.2, 0.4, 0.6]).write_png(&dir.join("b.png")).unwrap();
    place.write("photos/masks/lost.png", "");
    run().fails_with(&["photos: expected photographs that overlap", "no two of 2 photographs have 20 matches"]);
    assert_has(&text(&run().into_command().output().unwrap().stdout), &["colmap failed: ", "oops", "without an image"]);
    assert!(!dir.join("sparse").exists() && !dir.join("colmap.db").exists());
    Image::filled(360, 300, [0.5; 3]).write_png(&dir.join("c.png")).unwrap();
    run().fails_with(&["no two of 3 photographs have 20 matches"]);
    fs::write(dir.join("c.png"), "no picture").unwrap();
    run().fails_with(&["c.png"]);
}

/// The program places four of five photographs, and a stand-in for COLMAP those that it is given.
#[cfg(unix)]
#[test]
fn better_poses_of_two_solvers_are_kept() {
    let place = Workplace::new();
    let dir = place.path("photos");
    room(&dir, &[0, 1, 3, 9]);
    Image::filled(360, 360, [0.2, 0.4, 0.6]).write_png(&dir.join("10.png")).unwrap();
    write_colmap(&place, "#!/bin/sh\nif [ \"$1 $2\" = 'mapper --database_path' ]; then cp -r model \"$7/0\"; fi\n");
    place.write("model/cameras.txt", "1 SIMPLE_PINHOLE 360 360 300 180 180\n");
    // Returns the output if COLMAP places `placed`, and asserts that `expected` photographs are placed in the end.
    let from_images = |arguments: &str, placed: &[&str], expected: usize| {
        let image = |(i, name): (usize, &&str)| format!("{} 1 0 0 0 {i} 0 0 1 {name}.png\n1 1 -1\n", i + 1);
        let images: String = placed.iter().enumerate().map(image).collect();
        place.write("model/images.txt", images);
        let _ = fs::remove_dir_all(dir.join("sparse"));
        let path = format!("{}:{}", place.path("").display(), std::env::var("PATH").unwrap_or_default());
        let stdout = place.run(format!("scene from-images photos {arguments}")).env("PATH", path).stdout();
        assert!(!dir.join("poses.partial").exists());
        assert_eq!(Reconstruction::read(&dir).unwrap().images.len(), expected);
        stdout
    };
    let own = "this program's poses are kept: colmap placed 2 of 5 photographs, this program 4 of 5";
    assert_has(&from_images("", &["00", "01"], 4), &[own]);
    let theirs = "colmap's poses are kept: colmap placed 5 of 5 photographs, this program 4 of 5";
    assert_has(&from_images("", &["00", "01", "03", "09", "10"], 5), &[theirs]);
    let stdout = from_images("--poses colmap", &["00", "01"], 2);
    let unplaced = "03.png: not placed: colmap did not register it";
    assert!(stdout.contains(unplaced) && !stdout.contains("features"), "{stdout}");
    fs::remove_file(dir.join("10.png")).unwrap();
    let stdout = from_images("", &["00", "01"], 4);
    assert!(stdout.contains("4 of 4 photographs placed") && !stdout.contains("colmap"), "{stdout}");
}
