//! Poses that no photograph was taken from: unseen views, neighbours and camera paths.

mod cap;
mod centre;
mod orbit;
mod unseen;

pub(crate) use centre::view_directions;
pub use orbit::orbit;
pub use unseen::{ViewRegion, unseen_pose};

use glam::{DMat3, DMat4};
use rand::Rng;

/// A pose near `pose`: three angles from U(−a, a), a = `max_angle_deg` degrees, rotate it about the
/// *world origin*, position and orientation alike: `R_x(α) · R_y(β) · R_z(γ) · pose`.
///
/// This is the neighbour rule of information-gain reduction: both rays of a pair then pass the
/// origin at the same distance. The sign of `max_angle_deg` does not matter; one that is not finite
/// counts as 0.
pub fn near_pose(pose: &DMat4, rng: &mut impl Rng, max_angle_deg: f64) -> DMat4 {
    let a = if max_angle_deg.is_finite() { max_angle_deg.to_radians() } else { 0.0 };
    let mut angle = || a * (2.0 * rng.random::<f64>() - 1.0);
    let (x, y, z) = (angle(), angle(), angle());
    let rotation = DMat3::from_rotation_x(x) * DMat3::from_rotation_y(y) * DMat3::from_rotation_z(z);
    DMat4::from_mat3(rotation) * *pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    proptest! {
        #[test]
        fn near_pose_turns_about_the_origin(seed: u64, max in 0.0f64..10.0) {
            let pose = crate::camera::look_along(DVec3::new(1.0, 2.0, 3.0), DVec3::NEG_X, DVec3::Z);
            let near = near_pose(&pose, &mut ChaCha8Rng::seed_from_u64(seed), max);
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
    fn zero_or_non_finite_angle_keeps_the_pose() {
        let pose = DMat4::from_translation(DVec3::X);
        for angle in [0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(near_pose(&pose, &mut ChaCha8Rng::seed_from_u64(0), angle), pose);
        }
    }
}
