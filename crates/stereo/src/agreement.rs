//! Agreement of depth maps.

use infonerf_scene::Camera;
use rayon::prelude::*;

use crate::map::DepthMap;

/// Greatest difference between two views' disparities of one point, in steps between planes.
const TOLERANCE: f32 = 1.5;

/// Clears each pixel whose surface point is confirmed by no other view of `pairs`: one whose own map has, at the pixel
/// where it sees the point, the point's disparity to within [`TOLERANCE`] steps.
pub(crate) fn agreed(maps: &[DepthMap], cameras: &[Camera], pairs: &[Vec<usize>]) -> Vec<DepthMap> {
    let checked = |view: usize| {
        let (map, camera) = (&maps[view], &cameras[view]);
        let confirmed = |i: usize| {
            let disparity = map.disparity[i];
            if !disparity.is_finite() || disparity <= 0.0 {
                return false;
            }
            let (x, y) = ((i % map.width) as f32 + 0.5, (i / map.width) as f32 + 0.5);
            let point = camera.ray(x, y).at(1.0 / disparity);
            pairs[view].iter().any(|&other| {
                let there = &cameras[other];
                let inside =
                    |p: &glam::Vec2| p.x >= 0.0 && p.y >= 0.0 && p.x < there.width as f32 && p.y < there.height as f32;
                let Some(place) = there.project(point).filter(inside) else { return false };
                let Some((disparity, step)) = maps[other].at(there, place.x, place.y) else { return false };
                let distance = point.distance(there.position());
                (1.0 / distance - disparity).abs() <= TOLERANCE * step
            })
        };
        let disparity =
            (0..map.disparity.len()).map(|i| if confirmed(i) { map.disparity[i] } else { f32::NAN }).collect();
        DepthMap { disparity, ..map.clone() }
    };
    (0..maps.len()).into_par_iter().map(checked).collect()
}
