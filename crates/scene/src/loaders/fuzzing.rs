//! What reads files, on bytes: entry points for the fuzzers in `fuzz/` and for the tests that replay them.
//!
//! Each goes as far as it can without touching the disk, and returns whether the bytes were accepted: what fuzzing asks
//! is that it returns at all, with finite numbers where it accepts.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::extent::{capture_space, frusta_bounds};
use super::frames::transforms as read_transforms;
use super::json::JsonFile;
use super::{llff, npy};
use crate::image::decode_bytes;
use crate::poses::{ViewRegion, near_pose};
use crate::{Aabb, Camera, Range, ViewSelection};

/// The most frames that poses are derived from: time beyond that is the input's, not the reader's.
const MOST_FRAMES: usize = 64;

/// A `transforms*.json`, with the cameras, rays and poses that follow from it.
pub fn transforms(bytes: &[u8]) -> bool {
    let path = Path::new("transforms.json");
    let Ok(read) = JsonFile::parse(path, bytes).and_then(|file| read_transforms(path, &file)) else { return false };
    let cameras: Vec<Camera> = read.frames.iter().take(MOST_FRAMES).map(|frame| frame.camera(8, 6)).collect();
    let space = capture_space(&cameras, Vec::new(), Vec::new()).with(read.range, read.bounds);
    assert!(space.near <= space.far, "near and far: {} {}", space.near, space.far);
    follow(&cameras, space.bounds);
    true
}

/// A `poses_bounds.npy`, with the cameras, rays and poses that follow from it.
pub fn poses_bounds(bytes: &[u8]) -> bool {
    let path = Path::new(llff::MARKER);
    let array = npy::decode(path, bytes, bytes.len() as u64, llff::EXPECTED);
    let placed = array.and_then(|array| llff::rows(path, array)).and_then(|rows| llff::placed(path, &rows));
    let Ok((poses, range)) = placed else { return false };
    let camera = |pose| Camera::pinhole((8, 6), [9.0; 2], [4.0, 3.0], pose);
    let cameras: Vec<Camera> = poses.into_iter().take(MOST_FRAMES).map(camera).collect();
    if let Some(bounds) = frusta_bounds(&cameras, Range::Depth { near: range.0, far: range.1 }) {
        follow(&cameras, bounds);
    }
    true
}

/// An `.npy` of depths.
pub fn depth(bytes: &[u8]) -> bool {
    npy::decode(Path::new("depth.npy"), bytes, bytes.len() as u64, "depths").is_ok()
}

/// A PNG or JPEG.
pub fn image(bytes: &[u8]) -> bool {
    let Ok(image) = decode_bytes(Path::new("image.png"), bytes) else { return false };
    assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
    assert!(image.pixels.as_flattened().iter().all(|value| (0.0..=1.0).contains(value)));
    true
}

/// What training does with cameras.
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
            if let Some((enter, leave)) = bounds.intersect(&ray) {
                assert!(0.0 <= enter && enter <= leave, "the part of a ray in bounds: {enter} to {leave}");
            }
        }
    }
}
