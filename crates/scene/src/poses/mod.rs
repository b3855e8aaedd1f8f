//! Poses without a photograph: unseen views, neighbours and camera paths.

mod cap;
mod centre;
mod disturb;
mod orbit;
mod path;
mod similarity;
mod spiral;
mod unseen;

pub use cap::angle;
pub(crate) use centre::{FORWARD_FACING, cone, scene_focus, up_direction, view_directions};
pub use orbit::{figure_eight, orbit};
pub use path::{Keyframe, interpolate_keyframes, interpolate_views};
pub use similarity::{PoseError, Similarity, rotation_angle_deg};
pub use spiral::spiral;
pub use unseen::ViewRegion;

use glam::{DMat3, DMat4, DVec3};
use rand::Rng;

/// Returns a pose near `pose`: three angles from U(−a, a), a = `max_angle_deg` degrees, rotate it about `centre`, position
/// and orientation alike, by `R_x(α) · R_y(β) · R_z(γ)` in the world's axes. A point at the centre keeps its place in the image.
///
/// The released code of information-gain reduction rotates about the world's origin: both rays of a pair then pass it at the
/// same distance. The sign of `max_angle_deg` does not matter; one that is not finite counts as 0.
pub fn near_pose(pose: &DMat4, centre: DVec3, rng: &mut impl Rng, max_angle_deg: f64) -> DMat4 {
    let a = if max_angle_deg.is_finite() { max_angle_deg.to_radians() } else { 0.0 };
    let mut angle = || a * (2.0 * rng.random::<f64>() - 1.0);
    let (x, y, z) = (angle(), angle(), angle());
    let rotation = DMat3::from_rotation_x(x) * DMat3::from_rotation_y(y) * DMat3::from_rotation_z(z);
    let mut moved = *pose;
    moved.w_axis -= centre.extend(0.0);
    let mut near = DMat4::from_mat3(rotation) * moved;
    near.w_axis += centre.extend(0.0);
    near
}

/// Returns `a bᵀ`.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    proptest! {
        #[test]
        fn near_pose_turns_about_the_origin(seed: u64, max in 0.0f64..10.0) {
            let pose = crate::camera::look_along(DVec3::new(1.0, 2.0, 3.0), DVec3::NEG_X, DVec3::Z);
            let near = near_pose(&pose, DVec3::ZERO, &mut ChaCha8Rng::seed_from_u64(seed), max);
            let (p, q) = (pose.w_axis.truncate(), near.w_axis.truncate());
            prop_assert!((p.length() - q.length()).abs() < 1e-9);
            // Three rotations by at most `max` each turn nothing by more than 3 · max.
            prop_assert!(p.angle_between(q).to_degrees() <= 3.0 * max + 1e-6);
            // The same rotation takes the old orientation to the new one.
            let turn = DMat3::from_mat4(near) * DMat3::from_mat4(pose).transpose();
            prop_assert!((turn * p - q).length() < 1e-9);
        }
    }

    #[test]
    fn near_pose_keeps_the_centre_in_place() {
        let centre = DVec3::new(40.0, -7.0, 3.0);
        let pose = crate::camera::look_along(DVec3::new(44.0, -7.0, 3.0), DVec3::NEG_X, DVec3::Z);
        for seed in 0..20 {
            let near = near_pose(&pose, centre, &mut ChaCha8Rng::seed_from_u64(seed), 5.0);
            let local = |pose: &DMat4| pose.inverse().transform_point3(centre);
            assert!((local(&near) - local(&pose)).length() < 1e-9);
            assert!(((near.w_axis.truncate() - centre).length() - 4.0).abs() < 1e-9);
        }
        for angle in [0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(near_pose(&pose, DVec3::ZERO, &mut ChaCha8Rng::seed_from_u64(0), angle), pose);
        }
    }
}
