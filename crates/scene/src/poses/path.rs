//! Smooth paths through given poses.

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::ViewRegion;
use crate::camera::Camera;

/// A pose that a camera path passes through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframe {
    /// Camera-to-world, rigid, OpenGL axes.
    pub pose: DMat4,
    /// Vertical field of view in radians; `None` keeps the intrinsics of the camera that follows the path.
    pub fov_y: Option<f64>,
}

/// Returns `n` frames along a path through `keyframes`, which passes from each to the next in equal time.
///
/// Positions follow a Catmull-Rom spline, rotations are interpolated spherically (slerp), and fields of view linearly
/// between neighbours. A closed path returns to its first keyframe and stops one frame short of it, so that it can be
/// repeated; an open one starts and ends exactly on the first and the last keyframe. Empty without keyframes.
pub fn interpolate_keyframes(keyframes: &[Keyframe], closed: bool, n: usize) -> Vec<Keyframe> {
    let positions: Vec<DVec3> = keyframes.iter().map(|k| k.pose.w_axis.truncate()).collect();
    let rotations: Vec<DQuat> = keyframes.iter().map(|k| rotation(&k.pose)).collect();
    places(keyframes.len(), closed, n)
        .map(|Place { from, to, share }| {
            let fov_y = keyframes[from].fov_y.zip(keyframes[to].fov_y).map(|(a, b)| a + share * (b - a));
            let turn = rotations[from].slerp(rotations[to], share);
            let position = spline(&positions, closed, from, to, share);
            Keyframe { pose: DMat4::from_rotation_translation(turn, position), fov_y }
        })
        .collect()
}

/// Returns `n` camera-to-world poses along a closed path that visits each camera's pose once, the nearest of those left next.
///
/// Cameras that face one way are interpolated as by [`interpolate_keyframes`]. Around an object straight lines between cameras
/// would lead through it: there the distance from the centre is interpolated on its own, and so is each camera's rotation
/// relative to looking at the centre, so that the centre stays in view.
pub fn interpolate_views(cameras: &[Camera], n: usize) -> Vec<DMat4> {
    let tour: Vec<DMat4> = nearest_first(cameras).iter().map(|camera| camera.to_world).collect();
    let region = ViewRegion::new(cameras);
    let keyframes: Vec<Keyframe> = tour.iter().map(|&pose| Keyframe { pose, fov_y: None }).collect();
    if region.faces_forward() || !region.focus.inward {
        return interpolate_keyframes(&keyframes, true, n).into_iter().map(|frame| frame.pose).collect();
    }
    let offsets: Vec<DVec3> = tour.iter().map(|pose| pose.w_axis.truncate() - region.centre()).collect();
    let facing = |offset: DVec3| region.pose(offset.normalize_or(region.up), offset.length());
    let residuals: Vec<DQuat> =
        tour.iter().zip(&offsets).map(|(pose, &offset)| rotation(&facing(offset)).inverse() * rotation(pose)).collect();
    places(tour.len(), true, n)
        .map(|Place { from, to, share }| {
            let length = offsets[from].length() + share * (offsets[to].length() - offsets[from].length());
            let direction = spline(&offsets, true, from, to, share).normalize_or(offsets[from].normalize_or(region.up));
            let facing = facing(length * direction);
            let turn = rotation(&facing) * residuals[from].slerp(residuals[to], share);
            DMat4::from_rotation_translation(turn, facing.w_axis.truncate())
        })
        .collect()
}

/// A position on a path: a fraction of the way from one keyframe to the next.
struct Place {
    from: usize,
    to: usize,
    share: f64,
}

/// Returns `n` positions, evenly spaced in time, on a path of `count` keyframes.
fn places(count: usize, closed: bool, n: usize) -> impl Iterator<Item = Place> {
    let segments = if closed { count } else { count.saturating_sub(1) };
    let steps = if closed { n } else { n.saturating_sub(1) }.max(1);
    (0..if count == 0 { 0 } else { n }).map(move |i| {
        // In integers, so that keyframes are hit exactly.
        let (segment, rest) = (i * segments / steps, i * segments % steps);
        let from = segment.min(count - 1);
        let to = if closed { (from + 1) % count } else { (from + 1).min(count - 1) };
        Place { from, to, share: rest as f64 / steps as f64 }
    })
}

/// Returns the Catmull-Rom spline at a fraction `s` of the way from point `from` to point `to`, its successor:
/// `h₀₀(s) p₁ + h₁₀(s) m₁ + h₀₁(s) p₂ + h₁₁(s) m₂` with the tangents `m₁ = (p₂ − p₀)/2`, `m₂ = (p₃ − p₁)/2`. An open
/// spline repeats its end points.
fn spline(points: &[DVec3], closed: bool, from: usize, to: usize, s: f64) -> DVec3 {
    let count = points.len();
    let before = if closed { (from + count - 1) % count } else { from.saturating_sub(1) };
    let after = if closed { (to + 1) % count } else { (to + 1).min(count - 1) };
    let [p0, p1, p2, p3] = [before, from, to, after].map(|i| points[i]);
    let (m1, m2) = (0.5 * (p2 - p0), 0.5 * (p3 - p1));
    let (s2, s3) = (s * s, s * s * s);
    (2.0 * s3 - 3.0 * s2 + 1.0) * p1 + (s3 - 2.0 * s2 + s) * m1 + (3.0 * s2 - 2.0 * s3) * p2 + (s3 - s2) * m2
}

fn rotation(pose: &DMat4) -> DQuat {
    DQuat::from_mat3(&DMat3::from_mat4(*pose))
}

/// Returns the cameras in the order of a walk that starts at the first and always goes to the nearest of those left.
fn nearest_first(cameras: &[Camera]) -> Vec<&Camera> {
    let mut left: Vec<&Camera> = cameras.iter().collect();
    let mut tour: Vec<&Camera> = Vec::with_capacity(left.len());
    while !left.is_empty() {
        let nearest = tour.last().map_or(0, |last| {
            let distance = |camera: &Camera| camera.position_f64().distance_squared(last.position_f64());
            (0..left.len()).min_by(|&a, &b| distance(left[a]).total_cmp(&distance(left[b]))).unwrap_or(0)
        });
        tour.push(left.remove(nearest));
    }
    tour
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{forward_cameras, looks_at_origin, train_cameras};

    fn keyframes() -> Vec<Keyframe> {
        let poses = train_cameras().into_iter().take(5).map(|camera| camera.to_world);
        poses.enumerate().map(|(i, pose)| Keyframe { pose, fov_y: Some(0.5 + 0.1 * i as f64) }).collect()
    }

    fn assert_same(found: &DMat4, expected: &DMat4) {
        assert!(found.abs_diff_eq(*expected, 1e-9), "{found} is not {expected}");
    }

    #[test]
    fn keyframes_are_met_exactly() {
        let keyframes = keyframes();
        // Three frames for each of the four segments, and the last keyframe.
        let open = interpolate_keyframes(&keyframes, false, 13);
        // Three frames for each of the five segments.
        let closed = interpolate_keyframes(&keyframes, true, 15);
        assert_eq!((open.len(), closed.len()), (13, 15));
        for (i, keyframe) in keyframes.iter().enumerate() {
            for path in [&open, &closed] {
                assert_same(&path[3 * i].pose, &keyframe.pose);
                assert!((path[3 * i].fov_y.unwrap() - keyframe.fov_y.unwrap()).abs() < 1e-12);
            }
        }
        let as_given = interpolate_keyframes(&keyframes, false, keyframes.len());
        as_given.iter().zip(&keyframes).for_each(|(frame, keyframe)| assert_same(&frame.pose, &keyframe.pose));
    }

    #[test]
    fn one_keyframe_or_none() {
        assert!(interpolate_keyframes(&[], true, 4).is_empty());
        let one = keyframes()[..1].to_vec();
        for closed in [false, true] {
            let still = interpolate_keyframes(&one, closed, 3);
            assert_eq!(still.len(), 3);
            still.iter().for_each(|frame| assert_same(&frame.pose, &one[0].pose));
        }
        assert_same(&interpolate_keyframes(&keyframes(), false, 1)[0].pose, &one[0].pose);
    }

    #[test]
    fn evenly_spaced_keyframes_on_a_line_give_a_straight_even_path() {
        let at = |x: f64| Keyframe { pose: DMat4::from_translation(DVec3::X * x), fov_y: None };
        let path = interpolate_keyframes(&[at(0.0), at(1.0), at(2.0), at(3.0)], false, 31);
        // End points are repeated, so the ends are slower.
        for (i, frame) in path.iter().enumerate().filter(|(i, _)| (10..=20).contains(i)) {
            assert!((frame.pose.w_axis.x - 0.1 * i as f64).abs() < 1e-12 && frame.pose.w_axis.y == 0.0);
        }
        assert!(path.windows(2).all(|pair| pair[0].pose.w_axis.x < pair[1].pose.w_axis.x));
    }

    #[test]
    fn views_around_an_object_are_visited_without_crossing_it() {
        let all = train_cameras();
        let cameras: Vec<Camera> = [26, 86, 2, 55].map(|i: usize| all[i].clone()).to_vec();
        let path = interpolate_views(&cameras, 40);
        for camera in &cameras {
            assert!(path.iter().any(|pose| pose.abs_diff_eq(camera.to_world, 1e-9)), "{}", camera.to_world);
        }
        for pose in &path {
            let position = pose.w_axis.truncate();
            assert!((position.length() - 4.0311).abs() < 1e-3 && looks_at_origin(pose), "{position}");
        }
        let alone = interpolate_views(&cameras[..1], 2);
        assert!(alone.len() == 2 && alone.iter().all(|pose| pose.abs_diff_eq(cameras[0].to_world, 1e-9)));
        assert!(interpolate_views(&[], 5).is_empty());
        assert!(interpolate_views(&forward_cameras(), 30).iter().all(|pose| pose.z_axis.z > 0.9));
    }

    proptest! {
        /// Every frame is a rotation and a position, and neighbours are near each other.
        #[test]
        fn paths_are_rigid_and_continuous(n in 60usize..200, closed: bool) {
            let path = interpolate_keyframes(&keyframes(), closed, n);
            for frame in &path {
                let r = DMat3::from_mat4(frame.pose);
                prop_assert!((r * r.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-9));
            }
            prop_assert!(path.windows(2).all(|pair| pair[1].pose.w_axis.distance(pair[0].pose.w_axis) < 1.0));
        }
    }
}
