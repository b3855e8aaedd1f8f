//! Closed camera paths for videos.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat4, DVec3};

use super::ViewRegion;
use crate::camera::Camera;

/// Returns `n` camera-to-world poses, evenly spaced along a closed path about the scene.
///
/// Cameras that surround a scene (or a single one) give a full circle about the up direction, half-way between their min and
/// max distance, at their mean elevation, starting at the first camera's azimuth. Several cameras within 26° of their central
/// direction, as in a forward-facing capture, give a small ellipse about that direction, at 0.7 of their max angles to the
/// sides and upwards: the rest was not photographed. With an `open` background, of which only the photographed part is known,
/// cameras that leave out more than 90° of the circle give a swing there and back over their arc; its poses `i` and `n - i`
/// are equal.
pub fn orbit(cameras: &[Camera], open: bool, n: usize) -> Vec<DMat4> {
    let region = ViewRegion::new(cameras);
    let radius = 0.5 * (region.radii().0 + region.radii().1);
    let turn = |i: usize| TAU * i as f64 / n as f64;

    if region.faces_forward() {
        let (axis, side, top) = forward_swing(&region);
        let direction = |a: f64| (axis + a.cos() * side + a.sin() * top).normalize();
        return (0..n).map(|i| region.pose(direction(turn(i)), radius)).collect();
    }

    let level = OrbitAngles::of(&region);
    let arc = level.covered(&region).filter(|_| open);
    let azimuth = |i: usize| arc.map_or(turn(i), |(middle, half)| middle - half * turn(i.min(n - i)).cos());
    (0..n).map(|i| region.pose(level.direction(azimuth(i), level.elevation), radius)).collect()
}

/// Returns `n` camera-to-world poses, evenly spaced along a figure eight that lies on its side, twice as wide as high,
/// half-way between the min and max distance of the cameras.
///
/// With the angle θ along it, cameras that face one way swing about their central direction by `(a sin θ, b sin 2θ)`: a
/// is 0.7 of their max angle to the sides, b of that upwards, at most a/2. Around an object, azimuth and elevation
/// swing like this about the first camera's azimuth and the mean elevation, with a = 0.6 (34°), and never over the top.
pub fn figure_eight(cameras: &[Camera], n: usize) -> Vec<DMat4> {
    let region = ViewRegion::new(cameras);
    let radius = 0.5 * (region.radii().0 + region.radii().1);
    let swing = |i: usize, width: f64, height: f64| {
        let angle = TAU * i as f64 / n as f64;
        (width * angle.sin(), height * (2.0 * angle).sin())
    };
    if region.faces_forward() {
        let (axis, side, top) = forward_swing(&region);
        let height = (0.5 * side.length() / top.length().max(1e-9)).min(1.0);
        let direction = |(x, y): (f64, f64)| (axis + x * side + y * top).normalize();
        return (0..n).map(|i| region.pose(direction(swing(i, 1.0, height)), radius)).collect();
    }
    let level = OrbitAngles::of(&region);
    let room = (FRAC_PI_2 - TOP - level.elevation.abs()).max(0.0);
    let pose = |(azimuth, height): (f64, f64)| region.pose(level.direction(azimuth, level.elevation + height), radius);
    (0..n).map(|i| pose(swing(i, SWING, (0.5 * SWING).min(room)))).collect()
}

/// Amplitude of a figure eight around an object, radians.
const SWING: f64 = 0.6;
/// Max width, in radians, of an arc without cameras that an orbit crosses if the background is open.
const GAP: f64 = FRAC_PI_2;
/// Min angle, in radians, between a figure eight and the point straight above the scene.
const TOP: f64 = 0.15;

/// Returns the central direction of cameras that face forward, and the offsets of paths from it sideways and upwards:
/// the tangents of 0.7 times the cameras' max angles.
fn forward_swing(region: &ViewRegion) -> (DVec3, DVec3, DVec3) {
    let axis = region.cap.axis;
    let side = region.up.cross(axis).normalize_or(axis.any_orthonormal_vector());
    let swing = |along: DVec3| {
        let angles = region.directions.iter().map(|direction| direction.dot(along).atan2(direction.dot(axis)).abs());
        (0.7 * angles.fold(0.0, f64::max)).tan() * along
    };
    (axis, swing(side), swing(axis.cross(side)))
}

/// Azimuth and elevation about a scene: 0 is the first camera's azimuth.
struct OrbitAngles {
    start: DVec3,
    side: DVec3,
    up: DVec3,
    /// Mean elevation of the cameras.
    elevation: f64,
}

impl OrbitAngles {
    fn of(region: &ViewRegion) -> Self {
        let (up, directions) = (region.up, &region.directions);
        let count = directions.len() as f64;
        let elevation = directions.iter().map(|d| d.dot(up).clamp(-1.0, 1.0).asin()).sum::<f64>() / count;
        let level = |d: DVec3| d - up * d.dot(up);
        let start = directions.first().map_or(DVec3::X, |&d| level(d)).normalize_or(up.any_orthonormal_vector());
        Self { start, side: up.cross(start), up, elevation }
    }

    /// Returns the middle and half the width of the arc of azimuths that the cameras of `region` cover. `None` if they
    /// leave out no more than [`GAP`], or there is only one.
    fn covered(&self, region: &ViewRegion) -> Option<(f64, f64)> {
        let azimuth = |d: &DVec3| d.dot(self.side).atan2(d.dot(self.start));
        let mut azimuths: Vec<f64> = region.directions.iter().map(azimuth).collect();
        azimuths.sort_by(f64::total_cmp);
        let after = azimuths.iter().skip(1).copied().chain(azimuths.first().map(|first| first + TAU));
        let (gap, end) =
            azimuths.iter().zip(after).map(|(at, next)| (next - at, next)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let half = 0.5 * (TAU - gap);
        (gap > GAP && azimuths.len() > 1).then_some((end + half, half))
    }

    fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        let ((s, c), (sin, cos)) = (azimuth.sin_cos(), elevation.sin_cos());
        cos * (c * self.start + s * self.side) + sin * self.up
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{forward_cameras, looks_at_origin, train_cameras};

    #[test]
    fn object_orbit_is_level_and_closed() {
        let path = orbit(&train_cameras(), true, 8);
        assert_eq!(path.len(), 8);
        let azimuth = |pose: &DMat4| pose.w_axis.y.atan2(pose.w_axis.x);
        assert!((azimuth(&path[0]) - azimuth(&train_cameras()[0].to_world)).abs() < 1e-6, "starts at the first camera");
        let heights: Vec<_> = path.iter().map(|p| p.w_axis.z).collect();
        assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-3 && *z > 0.5));
        let sum: DVec3 = path.iter().map(|p| p.w_axis.truncate()).sum();
        assert!(sum.x.abs() < 1e-2 && sum.y.abs() < 1e-2);
        assert!(path.iter().all(looks_at_origin));
        assert!(orbit(&forward_cameras(), true, 12).iter().all(|p| p.z_axis.z > 0.9), "forward");
        assert_eq!((orbit(&[], true, 0).len(), orbit(&[], false, 3).len()), (0, 3));
    }

    #[test]
    fn an_orbit_stays_where_cameras_were() {
        let mut arc = train_cameras();
        arc.retain(|camera| camera.to_world.w_axis.x > 1.0 && camera.to_world.w_axis.z > 0.5);
        let lowest = |open: bool| orbit(&arc, open, 60).iter().map(|pose| pose.w_axis.x).fold(f64::INFINITY, f64::min);
        let swing = orbit(&arc, true, 60);
        assert!((1..30).all(|i| swing[i] == swing[60 - i] && swing[i] != swing[i - 1]));
        assert!(arc.len() > 8 && lowest(false) < -2.0 && lowest(true) > 0.0, "{} {}", lowest(false), lowest(true));
    }

    /// Checks that paths of cameras in a row stay in the row.
    #[test]
    fn forward_paths_stay_among_the_cameras() {
        let row: Vec<Camera> = forward_cameras().into_iter().filter(|camera| camera.to_world.w_axis.y > 0.0).collect();
        for pose in [orbit(&row, true, 12), figure_eight(&row, 12)].concat() {
            let position = pose.w_axis;
            assert!((position.y - 0.5).abs() < 0.05 && position.x.abs() < 0.75, "{position}");
        }
        assert!(orbit(&row, true, 12).iter().any(|pose| pose.w_axis.x > 0.6));
    }

    #[test]
    fn a_figure_eight_crosses_itself_once() {
        let path = figure_eight(&train_cameras(), 8);
        let [start, crossing] = [0, 4].map(|i| path[i].w_axis);
        assert!((start - crossing).length() < 1e-9);
        assert_eq!(path.iter().filter(|pose| (pose.w_axis - start).length() > 1e-3).count(), 6);
        for pose in path {
            let distance = pose.w_axis.truncate().length();
            assert!((distance - 4.0311).abs() < 1e-3 && pose.y_axis.z > 0.0 && looks_at_origin(&pose));
        }
        assert!(figure_eight(&forward_cameras(), 12).iter().all(|pose| pose.z_axis.z > 0.98));
        assert!(figure_eight(&[], 3).iter().all(|pose| pose.is_finite()));
    }
}
