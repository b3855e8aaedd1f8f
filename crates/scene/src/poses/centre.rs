//! Centre of a scene, and its up direction, from a set of cameras.

use glam::{DMat3, DVec3};

use super::cap::Cap;
use super::outer;
use crate::camera::Camera;

/// Weight of the prior in [`scene_focus`]. The prior decides for axes within about 0.01 rad of parallel.
const PRIOR: f64 = 1e-4;

/// Cameras within this half-angle (radians) of their mean direction are taken to face one way.
pub(crate) const FORWARD_FACING: f64 = 0.45;

/// Directions agree if the length of their mean is at least this: 32° if all make the same angle with it.
const AGREED: f64 = 0.85;

/// The centre of a scene and the way its cameras face it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Focus {
    /// The point nearest to all optical axes.
    pub centre: DVec3,
    /// Whether the cameras look towards the centre, as around an object, or away, as in a room.
    pub inward: bool,
}

impl Focus {
    /// Returns the direction of a camera on the sphere about the centre: from the centre back to it along
    /// its optical axis, or along the view where cameras look outwards.
    pub fn direction(&self, camera: &Camera) -> DVec3 {
        let forward = camera.forward_f64().normalize_or(DVec3::NEG_Z);
        if self.inward { -forward } else { forward }
    }
}

/// Returns the centre `c` that minimises `Σ‖(I − dᵢdᵢᵀ)(c − pᵢ)‖² + λn‖c − c₀‖²` over the optical axes
/// `pᵢ + t dᵢ`, λ = [`PRIOR`].
///
/// The prior `c₀` decides only where the axes do not: for one camera, identical or parallel ones. It is the mean over
/// the cameras of the point on each axis nearest to the world origin, where that is farther in front than the cameras'
/// spread about their mean; else the point at twice the spread, or at 1 where the spread is 0.
pub(crate) fn scene_focus(cameras: &[Camera]) -> Focus {
    let n = cameras.len() as f64;
    if cameras.is_empty() {
        return Focus { centre: DVec3::ZERO, inward: true };
    }
    let axes: Vec<(DVec3, DVec3)> =
        cameras.iter().map(|c| (c.position_f64(), c.forward_f64().normalize_or(DVec3::NEG_Z))).collect();
    let mean = axes.iter().map(|a| a.0).sum::<DVec3>() / n;
    let spread = (axes.iter().map(|a| a.0.distance_squared(mean)).sum::<f64>() / n).sqrt();
    let ahead = |p: DVec3, d: DVec3| match -p.dot(d) {
        to_origin if to_origin > spread.max(1e-9) => to_origin,
        _ if spread > 1e-9 => 2.0 * spread,
        _ => 1.0,
    };
    let prior = axes.iter().map(|&(p, d)| p + ahead(p, d) * d).sum::<DVec3>() / n;

    let mut a = DMat3::IDENTITY * (PRIOR * n);
    let mut b = PRIOR * n * prior;
    for &(p, d) in &axes {
        let across = DMat3::IDENTITY - outer(d, d);
        a += across;
        b += across * p;
    }
    // Positive definite: every eigenvalue is at least PRIOR · n.
    let centre = a.inverse() * b;
    let centre = if centre.is_finite() { centre } else { prior };
    let towards: f64 = axes.iter().map(|&(p, d)| d.dot((centre - p).normalize_or_zero())).sum();
    Focus { centre, inward: towards >= 0.0 }
}

/// Returns unit directions of the cameras on the sphere about the scene's centre, see [`Focus::direction`].
pub(crate) fn view_directions(cameras: &[Camera]) -> Vec<DVec3> {
    let focus = scene_focus(cameras);
    cameras.iter().map(|c| focus.direction(c)).collect()
}

/// Returns the half-angle, in radians, of the smallest cone that holds all viewing directions.
pub(crate) fn cone(cameras: &[Camera]) -> f64 {
    let forward: Vec<DVec3> = cameras.iter().map(|c| c.forward_f64().normalize_or(DVec3::NEG_Z)).collect();
    Cap::enclosing(&forward, DVec3::NEG_Z).half_angle
}

/// Returns the world's up direction, from cameras that were held level: the unit vector most nearly at
/// right angles to all their x axes, on the side of their mean y axis.
///
/// Inverse iteration on `Σ xᵢxᵢᵀ` from the mean y axis; where the x axes leave a choice (one camera,
/// parallel x axes) the mean y axis decides. It also decides where all look one way with different rolls: the x axes
/// then lie in the image plane, and the direction perpendicular to them is the viewing axis.
pub fn up_direction(cameras: &[Camera]) -> DVec3 {
    let n = cameras.len() as f64;
    let mean_up: DVec3 = cameras.iter().map(|c| c.to_world.y_axis.truncate()).sum();
    let agreed = mean_up.length() > AGREED * n;
    let mean_up = mean_up.normalize_or(DVec3::Z);
    let forward: DVec3 = cameras.iter().map(Camera::forward_f64).sum();
    let forward = if forward.length() > AGREED * n { forward.normalize_or_zero() } else { DVec3::ZERO };
    let mut spread = DMat3::IDENTITY * (1e-3 * n.max(1.0));
    for right in cameras.iter().map(|camera| camera.to_world.x_axis.truncate()) {
        spread += outer(right, right);
    }
    let inverse = spread.inverse();
    let up = (0..4).fold(mean_up, |u, _| (inverse * u).normalize_or(u));
    let up = if up.is_finite() { up } else { mean_up };
    if agreed && up.dot(forward).abs() > 0.75 {
        return mean_up;
    }
    if up.dot(mean_up) < 0.0 { -up } else { up }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::look_along;
    use crate::testing::{level_camera as camera, train_cameras};

    #[test]
    fn object_cameras_meet_at_the_origin_with_z_up() {
        let cameras = train_cameras();
        for set in [&cameras[..], &cameras[..4], &cameras[..2]] {
            let focus = scene_focus(set);
            assert!(focus.centre.length() < 1e-6 && focus.inward);
            assert!(up_direction(set).dot(DVec3::Z) > 0.9999, "{}", up_direction(set));
        }
    }

    #[test]
    fn rolls_of_a_forward_facing_capture_do_not_make_its_axis_up() {
        let cameras: Vec<_> = (0..9)
            .map(|i| {
                let roll = (f64::from(i) - 4.0) * 0.09;
                let up = DVec3::new(roll.sin(), 0.02 * f64::from(i % 2), roll.cos());
                let position = DVec3::new(f64::from(i % 3), 0.0, f64::from(i / 3)) * 0.3;
                Camera::from_fov(8, 8, 0.7, look_along(position, DVec3::new(0.01 * roll, 1.0, 0.0), up))
            })
            .collect();
        let up = up_direction(&cameras);
        assert!(up.dot(DVec3::Z) > 0.97, "{up}");
    }

    #[test]
    fn one_camera_or_parallel_ones_get_a_centre_in_front() {
        let position = DVec3::new(0.0, -4.0, 3.0);
        let one = scene_focus(&[camera(position, -position)]);
        assert!(one.centre.length() < 1e-6 && one.inward);
        let row: Vec<_> = (0..4).map(|i| camera(DVec3::X * f64::from(i), DVec3::NEG_Z)).collect();
        let focus = scene_focus(&row);
        assert!(focus.inward);
        // Twice the root-mean-square distance from the middle.
        assert!(focus.centre.distance(DVec3::new(1.5, 0.0, -2.0 * 1.25f64.sqrt())) < 1e-9, "{}", focus.centre);
    }

    #[test]
    fn room_cameras_look_outward() {
        let outward = (0..6).map(|i| DVec3::new(f64::from(i).cos(), f64::from(i).sin(), 0.0));
        let focus = scene_focus(&outward.map(|d| camera(DVec3::Z + 0.5 * d, d)).collect::<Vec<_>>());
        assert!(!focus.inward && (focus.centre - DVec3::Z).length() < 0.05);
    }
}
