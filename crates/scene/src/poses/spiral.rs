use std::f64::consts::TAU;

use glam::{DMat4, DVec3};

use super::ViewRegion;
use crate::camera::{Camera, look_along};

/// Number of turns about the mean camera.
const TURNS: f64 = 2.0;
/// Number of swings along the viewing axis in one turn.
const SWINGS: f64 = 0.5;
/// Weight of the farthest disparity in the depth that the spiral looks at.
const FAR_SHARE: f64 = 0.75;
/// Quantile of the cameras' offsets from the mean that is the radius of the spiral.
const PERCENTILE: f64 = 0.9;
/// Max radius of the spiral, divided by the distance to the point that it looks at.
const MAX_RADIUS_RATIO: f64 = 0.25;

/// Returns `n` camera-to-world poses along the spiral of LLFF (Mildenhall et al. 2019; NeRF's videos of captures): two
/// turns about the mean camera, swinging to and fro once, all looking at one point.
///
/// In the mean camera's axes the position is `(cos θ · rₓ, −sin θ · r_y, −sin(θ/2) · r_z)`, with r the 90th percentile
/// of the cameras' distances from the mean along each axis, at most a quarter of the distance to the point looked at.
/// For cameras that face one way, this point is at the depth whose disparity is the mean of `1/(0.9 near)` and `1/(5
/// far)` with weights 1 : 3, else at the scene's centre. `range` is (near, far), scene units.
pub fn spiral(cameras: &[Camera], range: (f64, f64), n: usize) -> Vec<DMat4> {
    let region = ViewRegion::new(cameras);
    let (least, greatest) = region.radii();
    let (mean, focus) = if region.faces_forward() {
        let (near, far) = range;
        let depth = 1.0 / ((1.0 - FAR_SHARE) / (0.9 * near.max(1e-6)) + FAR_SHARE / (5.0 * far));
        let place = cameras.iter().map(Camera::position_f64).sum::<DVec3>() / cameras.len() as f64;
        let forward = cameras.iter().map(Camera::forward_f64).sum::<DVec3>();
        (look_along(place, forward, region.up), depth)
    } else {
        let radius = 0.5 * (least + greatest);
        (region.pose(region.cap.axis, radius), radius)
    };
    let offsets = || cameras.iter().map(|camera| mean.inverse().transform_point3(camera.position_f64()).abs());
    let reach = DVec3::from_array([0, 1, 2].map(|axis| percentile(offsets().map(|offset| offset[axis]))));
    let reach = reach.min(DVec3::splat(MAX_RADIUS_RATIO * focus));
    let target = mean.transform_point3(DVec3::NEG_Z * focus);
    let up = mean.y_axis.truncate();
    (0..n)
        .map(|i| {
            let angle = TAU * TURNS * i as f64 / n as f64;
            let local = DVec3::new(angle.cos(), -angle.sin(), -(angle * SWINGS).sin()) * reach;
            let position = mean.transform_point3(local);
            look_along(position, target - position, up)
        })
        .collect()
}

/// Returns the [`PERCENTILE`] of `values`, interpolated; 0 for none.
fn percentile(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let place = PERCENTILE * last as f64;
    let (low, high) = (values[place.floor() as usize], values[place.ceil() as usize]);
    low + place.fract() * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{looks_at_origin, train_cameras};

    #[test]
    fn a_forward_facing_spiral_stays_among_the_cameras_and_looks_at_one_point() {
        let cameras: Vec<Camera> = (0..9)
            .map(|i| {
                let p = DVec3::new(f64::from(i % 3) - 1.0, 0.5 * f64::from(i / 3) - 0.5, 0.0);
                Camera::from_fov(8, 8, 0.7, look_along(p, DVec3::NEG_Z, DVec3::Y))
            })
            .collect();
        let (near, far) = (2.0, 50.0);
        let path = spiral(&cameras, (near, far), 24);
        let depth = 1.0 / (0.25 / (0.9 * near) + 0.75 / (5.0 * far));
        for pose in &path {
            let (position, forward) = (pose.w_axis.truncate(), -pose.z_axis.truncate());
            assert!(position.abs().cmple(DVec3::new(1.0, 0.5, 0.0) + 1e-9).all(), "{position}");
            assert!(forward.dot((DVec3::NEG_Z * depth - position).normalize()) > 1.0 - 1e-9);
        }
        // Two turns: the second passes the same places.
        assert!((path[0].w_axis - path[12].w_axis).length() < 1e-9);
    }

    #[test]
    fn any_cameras_give_proper_poses() {
        let cameras = train_cameras();
        for set in [&cameras[..], &cameras[..1], &[]] {
            let path = spiral(set, (2.0, 6.0), 10);
            assert!(path.len() == 10 && path.iter().all(|pose| pose.is_finite()));
        }
        // Around an object, all poses look at the centre, from at least three quarters of the distance.
        for pose in spiral(&cameras, (2.0, 6.0), 10) {
            assert!(pose.w_axis.truncate().length() > 3.0 && looks_at_origin(&pose));
        }
    }
}
