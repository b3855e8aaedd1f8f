//! The file readers applied to bytes: entry points for the fuzzers in `fuzz/` and for the tests that replay them.
//!
//! Nothing touches the disk. Fuzzing checks that each reader returns, and that accepted bytes give finite numbers.

use std::path::Path;

use glam::DVec3;
use infonerf_scene::image::decode_bytes;
use infonerf_scene::poses::{ViewRegion, near_pose};
use infonerf_scene::{Camera, Range, ViewSelection};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::capture::{capture_space, frusta_bounds};
use crate::colmap::{self, read::Values};
use crate::files::{json, npy};
use crate::loaders::transforms::transforms as read_transforms;
use crate::loaders::{dtu, llff, zju};

/// Maximum number of frames from which poses are derived, which bounds the time of one input.
const MAX_FRAMES: usize = 64;

/// Reads `bytes` with the reader `target`. Then selects and perturbs the cameras and casts rays through them, as
/// training does. Returns whether the bytes are accepted.
pub fn run(target: &str, bytes: &[u8]) -> bool {
    let path = Path::new(target);
    let cameras = match target {
        "transforms" => transforms(path, bytes),
        "poses_bounds" => poses_bounds(path, bytes),
        "depth" => npy::decode(path, bytes, "depths").ok().map(|_| Vec::new()),
        "colmap" => colmap(path, bytes),
        "cameras_npz" => cameras_npz(path, bytes),
        "annots" => zju::annotations(path, bytes, 0).ok().map(|read| read.cameras),
        "image" => image(path, bytes),
        _ => None,
    };
    let Some(mut cameras) = cameras else { return false };
    cameras.truncate(MAX_FRAMES);
    cameras.iter_mut().for_each(|camera| (camera.width, camera.height) = (8, 6));
    if cameras.is_empty() {
        return true;
    }
    let bounds = capture_space(&cameras, Vec::new(), Vec::new()).bounds;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for selection in [ViewSelection::Seed { seed: 0, count: 2 }, ViewSelection::Wide { count: 2, seed: 0 }] {
        // Fewer cameras are an error.
        let _ = selection.select(&cameras);
    }
    let unseen = ViewRegion::new(&cameras).sample(&mut rng);
    assert!(unseen.is_finite(), "an unseen pose that is not finite");
    for camera in &cameras {
        let near = camera.with_pose(near_pose(&camera.to_world, DVec3::ZERO, &mut rng, 5.0));
        for ray in [camera.ray(0.5, 0.5), near.ray(7.5, 5.5)] {
            assert!(ray.direction.is_finite(), "a ray that is not finite");
            if let Some((enter, leave)) = bounds.intersect(&ray) {
                assert!(0.0 <= enter && enter <= leave, "the part of a ray in bounds: {enter} to {leave}");
            }
        }
    }
    true
}

fn transforms(path: &Path, bytes: &[u8]) -> Option<Vec<Camera>> {
    let read = json::parse(path, bytes).and_then(|value| read_transforms(path, &value)).ok()?;
    let cameras: Vec<Camera> = read.frames.iter().take(MAX_FRAMES).map(|frame| frame.camera(8, 6)).collect();
    if cameras.is_empty() {
        return None;
    }
    let space = capture_space(&cameras, Vec::new(), Vec::new()).with(read.range, read.bounds);
    assert!(space.near <= space.far, "near and far: {} {}", space.near, space.far);
    Some(cameras)
}

fn poses_bounds(path: &Path, bytes: &[u8]) -> Option<Vec<Camera>> {
    let rows = npy::decode(path, bytes, llff::EXPECTED).and_then(|array| llff::rows(path, array)).ok()?;
    let (poses, (near, far)) = llff::scaled_and_recentred(path, &rows).ok()?;
    let camera = |pose| Camera::pinhole((8, 6), [9.0; 2], [4.0, 3.0], pose);
    let cameras: Vec<Camera> = poses.into_iter().take(MAX_FRAMES).map(camera).collect();
    frusta_bounds(&cameras, Range::Depth { near, far });
    Some(cameras)
}

/// Reads a file of a COLMAP reconstruction, binary or text: cameras, images or points.
fn colmap(path: &Path, bytes: &[u8]) -> Option<Vec<Camera>> {
    let text = String::from_utf8_lossy(bytes);
    let sources = || [Values::binary(path, bytes), Ok(Values::text(path, &text))];
    let cameras = sources().map(|values| values.and_then(colmap::read::cameras).ok());
    let images = sources().map(|values| values.and_then(colmap::read::images).ok());
    let points = sources().map(|values| values.and_then(colmap::read::points).is_ok());
    for image in images.iter().flatten().flatten() {
        assert!(image.pose.is_finite(), "a pose that is not finite");
    }
    let poses = infonerf_procedural::train_cameras(8);
    let lenses = cameras.iter().flatten().flat_map(|all| all.values()).take(MAX_FRAMES / 3);
    let taken = lenses.flat_map(|lens| poses[..3].iter().map(|camera| lens.at(camera.to_world))).collect();
    let is_read = cameras.iter().any(Option::is_some) || images.iter().any(Option::is_some) || points.contains(&true);
    is_read.then_some(taken)
}

fn cameras_npz(path: &Path, bytes: &[u8]) -> Option<Vec<Camera>> {
    let matrices = npy::decode_archive(path, bytes, dtu::EXPECTED, |_| true).ok()?;
    let cameras: Vec<Camera> = (0..3).map_while(|i| dtu::camera(path, &matrices, i, (8, 6)).ok()).collect();
    (!cameras.is_empty()).then_some(cameras)
}

fn image(path: &Path, bytes: &[u8]) -> Option<Vec<Camera>> {
    let image = decode_bytes(path, bytes).ok()?;
    assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
    assert!(image.pixels.as_flattened().iter().all(|value| (0.0..=1.0).contains(value)));
    Some(Vec::new())
}
