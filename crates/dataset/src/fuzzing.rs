//! The file readers applied to bytes: entry points for the fuzzers in `fuzz/` and for the tests that replay them.
//!
//! Each goes as far as it can without touching the disk, and returns whether the bytes were accepted: fuzzing asks
//! that it returns at all, with finite numbers if it accepts.

use std::path::Path;

use infonerf_scene::image::decode_bytes;
use infonerf_scene::poses::{ViewRegion, near_pose};
use infonerf_scene::{Aabb, Camera, Range, ViewSelection};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::capture::{capture_space, frusta_bounds};
use crate::colmap::{self, read::Values};
use crate::files::json::JsonFile;
use crate::files::{npy, npz};
use crate::loaders::transforms::transforms as read_transforms;
use crate::loaders::{dtu, llff, zju};

/// A fuzz target: its name, and its reader, which returns whether it accepts the bytes.
pub type Target = (&'static str, fn(&[u8]) -> bool);

/// All fuzz targets.
pub const TARGETS: [Target; 7] = [
    ("transforms", transforms),
    ("poses_bounds", poses_bounds),
    ("depth", depth),
    ("colmap", colmap),
    ("cameras_npz", cameras_npz),
    ("annots", annots),
    ("image", image),
];

/// Maximum number of frames from which poses are derived, which bounds the time of one input.
const MAX_FRAMES: usize = 64;

/// Reads a `transforms*.json`, and derives the cameras, rays and poses that follow from it.
pub fn transforms(bytes: &[u8]) -> bool {
    let path = Path::new("transforms.json");
    let Ok(read) = JsonFile::parse(path, bytes).and_then(|file| read_transforms(path, &file)) else { return false };
    let cameras: Vec<Camera> = read.frames.iter().take(MAX_FRAMES).map(|frame| frame.camera(8, 6)).collect();
    let space = capture_space(&cameras, Vec::new(), Vec::new()).with(read.range, read.bounds);
    assert!(space.near <= space.far, "near and far: {} {}", space.near, space.far);
    follow(&cameras, space.bounds);
    true
}

/// Reads a `poses_bounds.npy`, and derives the cameras, rays and poses that follow from it.
pub fn poses_bounds(bytes: &[u8]) -> bool {
    let path = Path::new(llff::MARKER);
    let array = npy::decode(path, bytes, llff::EXPECTED);
    let placed = array.and_then(|array| llff::rows(path, array)).and_then(|rows| llff::placed(path, &rows));
    let Ok((poses, range)) = placed else { return false };
    let camera = |pose| Camera::pinhole((8, 6), [9.0; 2], [4.0, 3.0], pose);
    let cameras: Vec<Camera> = poses.into_iter().take(MAX_FRAMES).map(camera).collect();
    if let Some(bounds) = frusta_bounds(&cameras, Range::Depth { near: range.0, far: range.1 }) {
        follow(&cameras, bounds);
    }
    true
}

/// Reads an `.npy` of depths.
pub fn depth(bytes: &[u8]) -> bool {
    npy::decode(Path::new("depth.npy"), bytes, "depths").is_ok()
}

/// Reads a file of a COLMAP reconstruction, binary or text, whichever of the three it may be.
pub fn colmap(bytes: &[u8]) -> bool {
    let path = Path::new("colmap");
    let text = String::from_utf8_lossy(bytes);
    let sources = || [Values::binary(path, bytes), Ok(Values::text(path, &text))];
    let cameras = sources().map(|values| values.and_then(colmap::read::cameras).ok());
    let images = sources().map(|values| values.and_then(colmap::read::images).ok());
    let points = sources().map(|values| values.and_then(colmap::read::points).is_ok());
    for camera in cameras.iter().flatten().flat_map(|all| all.values()).take(MAX_FRAMES) {
        let poses = infonerf_procedural::train_cameras(8);
        let cameras: Vec<Camera> = poses[..3].iter().map(|c| camera.at(c.to_world)).collect();
        follow(&cameras, capture_space(&cameras, Vec::new(), Vec::new()).bounds);
    }
    for image in images.iter().flatten().flatten() {
        assert!(image.pose.is_finite(), "a pose that is not finite");
    }
    cameras.iter().any(Option::is_some) || images.iter().any(Option::is_some) || points.contains(&true)
}

/// Reads a `cameras_sphere.npz`, and derives the cameras that follow from it.
pub fn cameras_npz(bytes: &[u8]) -> bool {
    let path = Path::new("cameras_sphere.npz");
    let Ok(matrices) = npz::decode(path, bytes, dtu::EXPECTED, |_| true) else { return false };
    let cameras: Vec<Camera> = (0..3).map_while(|i| dtu::camera(path, &matrices, i, (8, 6)).ok()).collect();
    follow(&cameras, Aabb::cube(glam::Vec3::ZERO, 1.0));
    !cameras.is_empty()
}

/// Reads an `annots.npy`, and derives the cameras that follow from it.
pub fn annots(bytes: &[u8]) -> bool {
    let Ok(read) = zju::annotations(Path::new("annots.npy"), bytes, 0) else { return false };
    let size = |camera: &Camera| Camera { width: 8, height: 6, ..camera.clone() };
    let cameras: Vec<Camera> = read.cameras.iter().take(MAX_FRAMES).map(size).collect();
    follow(&cameras, capture_space(&cameras, Vec::new(), Vec::new()).bounds);
    true
}

/// Decodes a PNG or JPEG.
pub fn image(bytes: &[u8]) -> bool {
    let Ok(image) = decode_bytes(Path::new("image.png"), bytes) else { return false };
    assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
    assert!(image.pixels.as_flattened().iter().all(|value| (0.0..=1.0).contains(value)));
    true
}

/// Selects, perturbs and casts rays through cameras as training does.
fn follow(cameras: &[Camera], bounds: Aabb) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for selection in [ViewSelection::Seed { seed: 0, count: 2 }, ViewSelection::Wide { count: 2, seed: 0 }] {
        // Refused where there are fewer cameras.
        let _ = selection.select(cameras);
    }
    let unseen = ViewRegion::new(cameras).sample(&mut rng);
    assert!(unseen.is_finite(), "an unseen pose that is not finite");
    for camera in cameras {
        let near = camera.with_pose(near_pose(&camera.to_world, &mut rng, 5.0));
        for ray in [camera.ray(0.5, 0.5), near.ray(7.5, 5.5)] {
            assert!(ray.direction.is_finite(), "a ray that is not finite");
            if let Some((enter, leave)) = bounds.intersect(&ray) {
                assert!(0.0 <= enter && enter <= leave, "the part of a ray in bounds: {enter} to {leave}");
            }
        }
    }
}
